"""`python -m whiptool.rig`."""

import sys

from whiptool.rig.command import main

if __name__ == "__main__":
    sys.exit(main())
