"""Published figures, each with where it was read."""

FALL_SHARE = 0.85  # of the time of free fall, of a folded chain: Kucharski 1941, as C. W. Wong has it
# Calkin and March 1989 measured the largest pull at the support in weights of the chain, as Cline's "Variational
# Principles in Classical Mechanics" (Example 8.1) has it; the number of links is not given there
LARGEST_PULL = 25.0
# Mach number of the tip when a whip cracks: its loop, half as fast, is at Mach 1 (Goriely and McMillen 2002, who so
# explain why Krehl et al. saw tips at about Mach 2)
CRACK = 2.0
CRACK_SPEED = 744.0  # [m/s] of the tip when the shock appears: Krehl et al. 1998, as Science News of 2002 has it
PEOPLE_TIP = 28.9  # [m/s], median peak of people's discrete throws: Krotov et al. 2022, docs/human.md
PEOPLE_HAND = 6.0  # [m/s], their hand
