"""Entry point of `python -m whiptool.train`; see `whiptool.commands.train`."""

import sys

from whiptool.commands.train import main

if __name__ == "__main__":
    sys.exit(main())
