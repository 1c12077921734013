"""Reading what Krotov et al. 2022 published: a CSV file of throws, and a MATLAB v7.3 file of speeds and shapes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from whiptool.errors import InputError
from whiptool.extras import optional
from whiptool.given_files import parsing

Throws: TypeAlias = Any  # a pandas.DataFrame: what its columns hold, pandas' types do not know
STYLES = ("discrete", "rhythmic")
TABLE_FILES = ("trial_stats.csv", "WhipTask_TrialStats.csv")
MATLAB_FILES = ("whip_task_data.mat", "WhipTaskData.mat")
_SUM = 1e-9  # [m]: of distances that both files hold

# their columns, ours, and the range of each; the flag says whether a value may be missing
_COLUMNS: dict[str, tuple[str, float, float, bool]] = {
    "OrigTrialNum": ("throw", 1, 1e6, False),
    "Subj": ("person", 1, 1000, False),
    "Subj_Ranked": ("rank", 1, 1000, False),
    "SexFM": ("sex", 0, 1, False),
    "StyleDR": ("style", 1, 2, False),
    "Block": ("block", 1, 100, False),
    "Trial": ("trial", 1, 10_000, False),
    "MinDist": ("min_distance", 0, 10, False),
    "HitFlag": ("hit", 0, 1, False),
    "t_throwOnset": ("onset", 0, 60, False),
    "t_HSmax": ("peak_hand_time", 0, 60, False),
    "t_MinDist": ("closest_time", 0, 60, False),
    "t_InterTrial": ("interval", 0, 600, True),
    "PeakHandSpeed": ("peak_hand_speed", 0, 50, False),
    "PeakTipSpeed": ("peak_tip_speed", 0, 500, True),
    "WhipExt_PeakHand": ("extension", 0, 10, True),
    "WhipAzAng_PeakHand": ("whip_azimuth", -180, 180, True),
    "HandAzAng_PeakHand": ("hand_azimuth", -180, 180, True),
}
_WHOLE = ("throw", "person", "rank", "sex", "block", "trial", "hit")
_FIELDS = (
    "Subj", "StyleDR", "HSTimeMean", "HSmean", "HSstd", "WSTimeMean", "WSmean", "WSstd", "WhipPos_PeakHand",
    "MinDistList",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Speeds:
    """Mean speeds of one person in one style; T instants, M markers from the tip to the hand.

    Args:
        person: Number, as in the table of throws.
        style: One of `STYLES`.
        hand_t: From the beginning of the throw to the closest approach [s], (T,).
        hand: Of the hand [m/s], (T,).
        t: From the throw's onset to the closest approach [s], (T,).
        markers: Of the whip's markers and, last, of the hand [m/s], (M, T).
        spread: Their standard deviation over throws [m/s], (M, T).
    """

    person: int
    style: str
    hand_t: np.ndarray
    hand: np.ndarray
    t: np.ndarray
    markers: np.ndarray
    spread: np.ndarray

    @property
    def peaks(self) -> np.ndarray:
        """Return the largest mean speed of each marker [m/s], (M,)."""
        return self.markers.max(axis=1)

    @property
    def peak_times(self) -> np.ndarray:
        """Return when each marker is fastest, as a part of the time from onset to closest approach, (M,)."""
        return self.t[self.markers.argmax(axis=1)] / self.t[-1]


@dataclass(frozen=True, eq=False)
class People:
    """What was published of all people.

    Args:
        throws: A row per throw; columns `person`, `style`, `block`, `trial`, `min_distance` [m], `hit`, times `onset`,
            `peak_hand_time`, `closest_time` and `interval` [s], `peak_hand_speed`, `peak_tip_speed` [m/s], `extension`
            [m], `whip_azimuth`, `hand_azimuth` [deg], and `duration` [s] from onset to closest approach.
        speeds: Speeds of every person in every style.
        shapes: By style, places of ten markers of the whip, tip first, and of two of the handle, when the hand is
            fastest [m], (throws, 3, 12), in the order of the table.
    """

    throws: Throws
    speeds: tuple[Speeds, ...]
    shapes: dict[str, np.ndarray]

    def of_style(self, style: str) -> list[Speeds]:
        """Return the speeds of all people in a style, in the order of people."""
        return [one for one in self.speeds if one.style == style]


def read_people(folder: Path | str) -> People:
    """Read both files, under our names or theirs, and check them against each other.

    Args:
        folder: Which holds them.

    Raises:
        InputError: A file is missing, is not one, is of another version, or the two are not of the same throws.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise InputError(
            "folder", str(folder), "a folder that holds " + " and ".join((TABLE_FILES[0], MATLAB_FILES[0]))
        )
    table, matlab = (_find(folder, names) for names in (TABLE_FILES, MATLAB_FILES))
    throws = read_throws(table)
    speeds, shapes, distances = read_speeds(matlab)
    for style in STYLES:
        listed = throws.loc[throws["style"] == style, "min_distance"].to_numpy()
        if len(listed) != len(distances[style]) or len(listed) != len(shapes[style]):
            rule = f"as many {style} throws as {table.name} has ({len(listed)})"
            raise InputError(str(matlab), f"{len(distances[style])} {style} throws", rule)
        if not np.allclose(listed, distances[style], rtol=0, atol=_SUM):
            raise InputError(str(matlab), f"{style} throws with other distances", f"the throws of {table.name}")
    known = set(throws["person"])
    for one in speeds:
        if one.person not in known:
            raise InputError(str(matlab), f"person {one.person}", f"people of {table.name}")
    return People(throws, speeds, shapes)


def _find(folder: Path, names: tuple[str, ...]) -> Path:
    for name in names:
        if (folder / name).exists():
            return folder / name
    raise InputError("folder", str(folder), "a folder that holds " + " or ".join(names))


def read_throws(path: Path) -> Throws:
    """Return the table of throws, its columns under our names; see `People`.

    Raises:
        InputError: It is not a table, a column is missing, or a value is out of its range.
    """
    import pandas as pd

    if not path.is_file():
        raise InputError(str(path), "no file", "a CSV file of throws")
    try:
        raw: Any = pd.read_csv(path)
    except (OSError, UnicodeDecodeError, ValueError) as error:  # pandas' errors of parsing are ValueErrors
        raise InputError(str(path), "no table", f"a CSV file of throws ({' '.join(str(error).split())})") from None
    missing = [name for name in _COLUMNS if name not in raw.columns]
    if missing:
        raise InputError(str(path), f"a table without {', '.join(missing)}", "the columns of Krotov et al. 2022")
    if raw.empty:
        raise InputError(str(path), "no throws", "a row per throw")
    columns = {ours: _checked(path, raw, theirs) for theirs, (ours, *_) in _COLUMNS.items()}
    table: Any = pd.DataFrame(columns)
    table["style"] = np.array(STYLES)[table["style"].astype(int) - 1]
    for style in STYLES:
        if not (table["style"] == style).any():
            raise InputError(str(path), f"no {style} throws", "throws in both styles")
    table["duration"] = table["closest_time"] - table["onset"]
    backwards = int((~(table["duration"] > 0)).sum())
    if backwards:
        raise InputError(str(path), f"{backwards} throws that end before they begin", "t_MinDist behind t_throwOnset")
    return table


def _checked(path: Path, raw: Any, theirs: str) -> np.ndarray:
    """Return one column as numbers within its range, NaN where a value may be missing.

    Raises:
        InputError: A value is missing or out of range.
    """
    import pandas as pd

    ours, low, high, may_miss = _COLUMNS[theirs]
    values: np.ndarray = np.asarray(pd.to_numeric(raw[theirs], errors="coerce"), float)
    out = ~((values >= low) & (values <= high))
    wrong = out & ~(np.isnan(values) & raw[theirs].isna().to_numpy()) if may_miss else out
    if ours in _WHOLE or ours == "style":
        wrong |= values != np.round(values)
    if wrong.any():
        row = int(np.flatnonzero(wrong)[0])
        raise InputError(
            f"{path}: {theirs}", str(raw[theirs].iloc[row]), f"numbers from {low:g} to {high:g}", f"row {row + 2}"
        )
    if ours == "extension":
        values = np.where(values > 0, values, np.nan)  # 0 stands for a marker that was not seen
    return values.astype(int) if ours in _WHOLE else values


def read_speeds(path: Path) -> tuple[tuple[Speeds, ...], dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Return the mean speeds of every person and style, and by style shapes (throws, 3, 12) and distances (throws,).

    Raises:
        InputError: The file is not of MATLAB v7.3, or does not hold the structure; or h5py is not installed.
    """
    h5py = optional("h5py", "MATLAB v7.3 files")
    if not path.is_file():
        raise InputError(str(path), "no file", "a MATLAB v7.3 file")
    if not h5py.is_hdf5(path):
        raise InputError(str(path), "a file of another kind or version", "a MATLAB v7.3 (HDF5) file")
    with parsing(path, "MATLAB v7.3"), h5py.File(path) as file:
        return _speeds(path, file)


def _speeds(path: Path, file: Any) -> tuple[tuple[Speeds, ...], dict[str, np.ndarray], dict[str, np.ndarray]]:
    group: Any = file.get("WhipTask_TimeSeries", {})
    held = set(group.keys()) if hasattr(group, "keys") else set()
    missing = [name for name in _FIELDS if name not in held]
    if missing:
        where = ", ".join(missing) if held else "WhipTask_TimeSeries"
        raise InputError(
            str(path), f"a file without {where}", "the structure WhipTask_TimeSeries of Krotov et al. 2022"
        )
    found: list[Speeds] = []
    shapes: dict[str, np.ndarray] = {}
    distances: dict[str, np.ndarray] = {}
    for i in range(len(group["Subj"])):

        def field(name: str, i: int = i) -> np.ndarray:
            try:
                return np.array(file[group[name][i, 0]], float)
            except (TypeError, ValueError, KeyError, IndexError):
                given = "a field that is laid out in another way"
                raise InputError(f"{path}: {name}", given, "an array for each person and style") from None

        number, person = int(field("StyleDR").flat[0]), int(field("Subj").flat[0])
        if number not in (1, 2):
            raise InputError(f"{path}: StyleDR", number, "1 (discrete) or 2 (rhythmic)")
        style = STYLES[number - 1]
        if person == 0:  # all people together
            shapes[style] = _shaped(path, "WhipPos_PeakHand", field("WhipPos_PeakHand"), (None, 3, 12))
            distances[style] = field("MinDistList").ravel()
            continue
        hand_t, hand, t = (field(name).ravel() for name in ("HSTimeMean", "HSmean", "WSTimeMean"))
        both = [_shaped(path, name, field(name), (11, len(t))) for name in ("WSmean", "WSstd")]
        _shaped(path, "HSmean", hand, (len(hand_t),))
        found.append(_ordered(Speeds(person, style, hand_t, hand, t, *both)))
    for style in STYLES:
        if style not in shapes or not any(one.style == style for one in found):
            raise InputError(str(path), f"no {style} throws", "people in both styles, and both styles pooled")
    return tuple(found), shapes, distances


def _ordered(speeds: Speeds) -> Speeds:
    """Return the same with the tip first: it is at the end that is faster."""
    if speeds.peaks[0] >= speeds.peaks[-1]:
        return speeds
    flipped = speeds.markers[::-1], speeds.spread[::-1]
    return Speeds(speeds.person, speeds.style, speeds.hand_t, speeds.hand, speeds.t, *flipped)


def _shaped(path: Path, name: str, values: np.ndarray, shape: tuple[int | None, ...]) -> np.ndarray:
    """Return an array that has the shape that it should have.

    Raises:
        InputError: It has another, or speeds are not numbers.
    """
    fits = values.ndim == len(shape) and all(want in (None, got) for want, got in zip(shape, values.shape))
    if not fits:
        wanted = " x ".join("throws" if x is None else str(x) for x in shape)
        raise InputError(f"{path}: {name}", f"an array of shape {values.shape}", wanted)
    if name != "WhipPos_PeakHand" and not np.isfinite(values).all():
        raise InputError(f"{path}: {name}", "values that are not numbers", "speeds [m/s]")
    return values
