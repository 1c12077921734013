"""Trials to hit in joint space and in hand space: UR5e and Panda, DIRECT-L, CMA-ES, gradient and SAC.

Targets of the robots with stick and rope of rods are uniform in the shell of 0.9 to 1.6 m around the base, above the
ground and in front of it, the same for all. Joints follow their reference exactly (position control), in hand space
along the hand's straight path; the arm's limits are kept. A refused strike is a trial, and so is one with its
derivatives. Each target is searched by each method until the tip comes within 5 cm, or 600 trials are used up; bounds
are the usual ones. It is the study of `python -m whiptool.reproduce spaces`.

    python benchmarks/spaces.py [--quick] [--json] [--targets N] [--folder FOLDER]

With --folder, what is found stands there, and an interrupted run continues.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))  # where the folder `papers` is

from papers.aim.spaces import CAP, QUICK_CAP, QUICK_TARGETS, TARGETS, SpaceStudy
from whiptool.comparison import Store


def main() -> None:
    """Search and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="one target, few trials")
    parser.add_argument("--json", action="store_true", help="one JSON object instead of a table")
    parser.add_argument("--targets", type=int, help=f"how many; default: {TARGETS}, with --quick {QUICK_TARGETS}")
    parser.add_argument("--folder", type=Path, help="of what is found, to go on from")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as passing:
        folder = arguments.folder or Path(passing)
        folder.mkdir(parents=True, exist_ok=True)
        count = arguments.targets or (QUICK_TARGETS if arguments.quick else TARGETS)
        study = SpaceStudy.of(Store(folder), count, QUICK_CAP if arguments.quick else CAP)
    if arguments.json:
        print(json.dumps(study.summary()))
        return
    head, *rows = study.table()
    print("\n".join("| " + " | ".join(row) + " |" for row in (head, ["---"] * len(head), *rows)))


if __name__ == "__main__":
    main()
