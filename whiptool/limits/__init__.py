"""What a strike has to keep: limits of joints, motors and commands, clearance, and the order of judging them."""
