"""Entry point of `python -m whiptool.compare`; see `whiptool.commands.compare`."""

import sys

from whiptool.commands.compare import main

if __name__ == "__main__":
    sys.exit(main())
