COLORS = {"orange": "#E69F00", "blue": "#0072B2", "vermilion": "#D55E00"}
