"""Entry point of `python -m whiptool.studio`; see `whiptool.commands.studio`."""

import sys

from whiptool.commands.studio import main

if __name__ == "__main__":
    sys.exit(main())
