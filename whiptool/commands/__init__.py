"""Command lines: options, a run, what is printed. `python -m whiptool.NAME` and `whiptool NAME` end here."""
