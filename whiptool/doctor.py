"""Entry point of `python -m whiptool.doctor`; see `whiptool.commands.doctor`."""

import sys

from whiptool.commands.doctor import main

if __name__ == "__main__":
    sys.exit(main())
