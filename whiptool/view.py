"""Entry point of `python -m whiptool.view`; see `whiptool.commands.view`."""

import sys

from whiptool.commands.view import main

if __name__ == "__main__":
    sys.exit(main())
