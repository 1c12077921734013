"""Entry point of `python -m whiptool.robot`; see `whiptool.commands.robot`."""

import sys

from whiptool.commands.robot import main

if __name__ == "__main__":
    sys.exit(main())
