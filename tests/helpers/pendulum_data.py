"""Where the swings of a recorded pendulum are, which lie beside the repository."""

from __future__ import annotations

import os
from pathlib import Path

from repository import ROOT

DATA = Path(os.environ.get("WHIPTOOL_DATA") or ROOT.parent / "shared" / "data") / "multiarm_pendulum"
