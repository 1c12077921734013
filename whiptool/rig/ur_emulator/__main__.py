"""Entry point of `python -m whiptool.rig.ur_emulator`; see `whiptool.commands.emulators`, a layer above."""

import sys
from importlib import import_module

if __name__ == "__main__":
    sys.exit(import_module("whiptool.commands.emulators").ur())
