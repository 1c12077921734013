"""Robot arms with controllers of their own: their drivers, and strikes with them."""
