"""Entry point of `python -m whiptool.optimize`; see `whiptool.commands.optimize`."""

import sys

from whiptool.commands.optimize import main

if __name__ == "__main__":
    sys.exit(main())
