"""Entry point of `python -m whiptool.simulate`; see `whiptool.commands.simulate`."""

import sys

from whiptool.commands.simulate import main

if __name__ == "__main__":
    sys.exit(main())
