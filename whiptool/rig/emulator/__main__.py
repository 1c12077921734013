"""Entry point of `python -m whiptool.rig.emulator`; see `whiptool.commands.emulators`, a layer above this package."""

import sys
from importlib import import_module

if __name__ == "__main__":
    sys.exit(import_module("whiptool.commands.emulators").servos())
