"""Process of `--live`, which ends with the process that started it: `python -m whiptool.following RUN PORT FD`."""

import sys
from importlib import import_module

if __name__ == "__main__":
    import_module("whiptool.commands.following").serve_child(sys.argv[1], *map(int, sys.argv[2:]))
