"""Entry point of `python -m whiptool.recording`; see `whiptool.commands.recording`, a layer above this package."""

import sys
from importlib import import_module

if __name__ == "__main__":
    sys.exit(import_module("whiptool.commands.recording").main())
