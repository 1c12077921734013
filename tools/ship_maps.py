"""Packs maps that `make maps` built into the package: `python -m tools.ship_maps FOLDER`, which holds a run of each.

A run is one of `python -m whiptool.map build --model NAME` without other options, in a folder called NAME.
"""

from __future__ import annotations

import sys
from pathlib import Path

import whiptool as wt
from whiptool.strike_map.map_files import FOLDER, save_packed


def main() -> None:
    """Pack all runs of the folder."""
    for run in sorted(path for path in Path(sys.argv[1]).iterdir() if path.is_dir()):
        built, packed = wt.load_map(run), FOLDER / f"{run.name}.npz"
        if built.striker.rollout.model != wt.preset(run.name) or built.gate is None:
            raise SystemExit(f"{run}: no map of the preset {run.name} with a gate")
        save_packed(packed, built.answers, built.gate)
        print(f"{packed}: {len(built.answers)} answers, {packed.stat().st_size / 1e6:.1f} MB")


if __name__ == "__main__":
    main()
