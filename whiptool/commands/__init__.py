"""Command lines: options, runs and printed results. `python -m whiptool.NAME` and `whiptool NAME` call them."""
