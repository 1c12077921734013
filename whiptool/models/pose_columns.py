"""Columns of the hand's poses in tables: those of exported trajectories, and of logs."""

POSE = tuple(f"hand_{name}" for name in ("x", "y", "z", "qx", "qy", "qz", "qw"))  # place [m], unit quaternion
