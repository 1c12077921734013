"""Entry point of `python -m whiptool.map`; see `whiptool.commands.map`."""

import sys

from whiptool.commands.map import main

if __name__ == "__main__":
    sys.exit(main())
