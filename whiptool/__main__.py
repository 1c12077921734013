"""`python -m whiptool COMMAND` is `whiptool COMMAND`."""

import sys

from whiptool.commands.cli import main

if __name__ == "__main__":
    sys.exit(main())
