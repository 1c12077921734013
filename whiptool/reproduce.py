"""The door of `python -m whiptool.reproduce`: see `whiptool.commands.reproduce`."""

import sys

from whiptool.commands.reproduce import main

if __name__ == "__main__":
    sys.exit(main())
