"""Entry point of `python -m whiptool.identify`; see `whiptool.commands.identify`."""

import sys

from whiptool.commands.identify import main

if __name__ == "__main__":
    sys.exit(main())
