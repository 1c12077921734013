"""A short search from the command line."""

from __future__ import annotations

SEARCH = ["--no-video", "--method", "random", "--target", "1.25", "0.05", "--no-stop-at-hit", "--timestep", "0.002"]
SEARCH += ["--preset", "printed", "--max-trials", "20"]
