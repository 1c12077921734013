"""Entry point of `python -m whiptool.adapt`; see `whiptool.commands.adapt`."""

import sys

from whiptool.commands.adapt import main

if __name__ == "__main__":
    sys.exit(main())
