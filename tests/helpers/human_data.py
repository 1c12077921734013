"""Where people's throws are, which lie beside the repository; and made-up throws in the same two files."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from repository import ROOT

DATA = Path(os.environ.get("WHIPTOOL_DATA") or ROOT.parent / "shared" / "data") / "whip_humans"
needs_people = pytest.mark.skipif(not DATA.is_dir(), reason=f"people's throws are not beside the repository ({DATA})")
PEOPLE, BLOCKS, TRIALS = 4, 5, 4


def made_up_table() -> pd.DataFrame:
    """Return throws of four people in two styles, under the columns that were published."""
    rng = np.random.default_rng(0)
    rows, own = [], rng.standard_normal(PEOPLE + 1)
    for style in (1, 2):
        for person in range(1, PEOPLE + 1):
            for block in range(1, BLOCKS + 1):
                for trial in range(1, TRIALS + 1):
                    miss = max(0.001, 0.02 * style + 0.1 * rng.random() + 0.01 * own[person] - 0.002 * block)
                    shift, chance = own[person], rng.random(6)
                    numbers = {
                        "OrigTrialNum": len(rows) + 1,
                        "Subj": person,
                        "Subj_Ranked": person,
                        "SexFM": person % 2,
                        "StyleDR": style,
                        "Block": block,
                        "Trial": trial,
                        "MinDist": miss,
                        "HitFlag": int(miss < 0.07),
                        "t_throwOnset": 0.8 + 0.02 * shift + 0.05 * chance[0],
                        "t_HSmax": 1.1,
                        "t_MinDist": 1.3 + 0.1 * chance[0] * chance[1],
                        "t_InterTrial": 4 - style + 0.2 * shift + chance[1] if trial > 1 else np.nan,
                        "PeakHandSpeed": 5 + 0.3 * shift + chance[2],
                        "PeakTipSpeed": 25 + shift + 5 * chance[3],
                        "WhipExt_PeakHand": 1.4 + 0.02 * shift + 0.1 * chance[4],
                        "WhipAzAng_PeakHand": 10 * chance[5],
                        "HandAzAng_PeakHand": 20 * chance[0],
                    }
                    rows.append(numbers)
    return pd.DataFrame(rows)


def speeds_of(person: int, style: int) -> dict[str, np.ndarray]:
    """Return made-up mean speeds: a wave that gathers speed from the hand, the last row, to the tip."""
    t, hand_t = np.linspace(0.003, 0.6, 200), np.linspace(0.007, 1.4, 200)
    peaks, times = np.linspace(30 - style, 5, 11), np.linspace(0.55, 0.3, 11)
    speeds = 1 + (peaks[:, None] - 1 + 0.1 * person) * np.exp(-(((t - times[:, None]) / 0.1) ** 2))
    hand = 1 + (4.0 + 0.1 * person) * np.exp(-(((hand_t - 1.1) / 0.1) ** 2))
    return {
        "Subj": np.full((1, 1), person), "StyleDR": np.full((1, 1), style), "HSTimeMean": hand_t[None],
        "HSmean": hand[None], "HSstd": 0.1 * hand[None], "WSTimeMean": t[None], "WSmean": speeds,
        "WSstd": 0.1 * speeds,
    }  # fmt: skip


def write_made_up(folder: Path, table: pd.DataFrame | None = None) -> Path:
    """Write both files into a folder, and return it."""
    import h5py

    table = made_up_table() if table is None else table
    folder.mkdir(exist_ok=True)
    table.to_csv(folder / "trial_stats.csv", index=False)
    entries = [speeds_of(person, style) for style in (1, 2) for person in range(1, PEOPLE + 1)]
    for style in (1, 2):
        some = table[table["StyleDR"] == style]
        along = np.stack([1.9 + 0.12 * np.arange(12)[::-1], np.zeros(12), 0.3 - 0.03 * np.arange(12)[::-1]])
        shape = np.tile(along, (len(some), 1, 1))
        both = {"Subj": np.zeros((1, 1)), "StyleDR": np.full((1, 1), style), "WhipPos_PeakHand": shape}
        entries.append(both | {"MinDistList": some["MinDist"].to_numpy()[None]})
    names = [*speeds_of(1, 1), "WhipPos_PeakHand", "MinDistList"]
    with h5py.File(folder / "whip_task_data.mat", "w", userblock_size=512) as file:
        group = file.create_group("WhipTask_TimeSeries")
        for name in names:
            references = group.create_dataset(name, (len(entries), 1), dtype=h5py.ref_dtype)
            for i, entry in enumerate(entries):
                values = np.asarray(entry.get(name, np.zeros(2)), float)
                references[i, 0] = file.create_dataset(f"#refs#/{name}{i}", data=values).ref
    return folder
