"""What tests that start processes share."""

HANG = 3600.0  # [s]; nothing takes that long on a slow machine, and a test that hangs ends
