"""How well are recordings predicted that a fit has not seen? Real pendulums, people's throws, and recordings of yours.

    python benchmarks/real.py FOLDER ... [--ropes] [--quick] [--json] [--folder KEPT]

Each FOLDER holds one of these:

- `single.npz` and `double.npz`, the swings of the MultiArm-Pendulum project (MIT licence, arXiv:2205.06231);
- `trial_stats.csv` and `whip_task_data.mat`, people's throws (Krotov et al. 2022; GPL-3; `whiptool.human` says more);
- `real.toml`, which names recordings, a model and what is held out. Files are relative to the folder:

      recordings = ["double.npz"]    # as `python -m whiptool.identify` takes them
      held_out = [4, 11, 18, 25]     # numbers of recordings, from 0, or their names; or each = 5: every fifth
      model = "guess.toml"
      drive = "free"                 # as --drive
      free = ["com", "zero"]         # as --free
      pieces = [0.3]                 # optional, as --pieces; further: knots, per_recording, starts
      horizons = [0.5, 1, 2]         # optional [s], after the last reading that the prediction knows

Every recording that is held out is predicted by `fit(..., held_out=...)` as the command `identify` does it. Printed are
its errors at the horizons (readings within 0.1 s of them), and which shares of the readings the stated 50 and 90 %
predictive intervals hold; of swings also if they are predicted from their middle, by which nothing was chosen. Next to
a pendulum stands the plain fit: the textbook's equations with viscous friction, least squares by SciPy, the same
readings, and the spread of its residuals as interval. `--ropes` adds `benchmarks/ropes.py`.

With `--folder KEPT` every fit is kept there, and the same command goes on where it was left.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import json
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from peers.kept import kept

from whiptool.errors import InputError
from whiptool.given_files import read_toml
from whiptool.identification.drives import pieces as cut
from whiptool.identification.fit import FitOptions, fit
from whiptool.identification.inputs import common_controller, each_episode, opened, read_marker, tracked
from whiptool.identification.plant import BareArm, Plant, read_bare_arm
from whiptool.identification.results import Fit, RecordingFit
from whiptool.identification.variables import names_of
from whiptool.impedance import Controller
from whiptool.models import read_model
from whiptool.models.numbers import number
from whiptool.models.parameters import ArmLink, ArmParameters
from whiptool.recording.readers.angles import read_swings
from whiptool.recording.strike_recording import StrikeRecording

HORIZONS, AROUND = (0.5, 1.0, 1.5, 2.0), 0.1  # [s]
WITHIN = 1.5  # [s] after the last known reading, over which a recording's RMS error is taken
OTHER_STARTS = 2  # drawn, from which the classes of the first fit are judged again
LEAST = 40  # readings of a swing that is also predicted from its middle
FOLDS = 3  # every third recording is held out in turn
KEYS = ("recordings", "held_out", "each", "model", "drive", "free", "pieces", "knots", "per_recording", "starts",
        "horizons")  # fmt: skip
LISTS = ("recordings", "held_out", "free", "pieces", "per_recording", "horizons")


@dataclass(frozen=True)
class Given:
    """Recordings and how to fit them.

    Args:
        name: What the report calls them.
        recordings: All recordings.
        folds: Numbers of the recordings that are held out together, for one fit each.
        plant, free: Model at which fits start, and names of what is fitted.
        options: Options of the fit.
        horizons: Times after the last known reading at which errors are reported [s].
    """

    name: str
    recordings: list[StrikeRecording]
    folds: list[list[int]]
    plant: Plant
    free: tuple[str, ...]
    options: FitOptions
    horizons: tuple[float, ...] = HORIZONS
    others: list[Plant] = field(default_factory=list)


@dataclass(frozen=True)
class Predicted:
    """Errors of predicted readings and their intervals, by time after the last known reading [s], all (K,)."""

    after: np.ndarray
    error: np.ndarray
    half: np.ndarray
    most: np.ndarray

    def row(self, chosen: np.ndarray) -> dict[str, float]:
        """RMS and median of the errors, and the coverages, of chosen readings."""
        e = np.abs(self.error[chosen])
        return {
            "rms": float(np.sqrt(np.mean(e**2))),
            "median": float(np.median(e)),
            "coverage_50": float(np.mean(e <= self.half[chosen])),
            "coverage_90": float(np.mean(e <= self.most[chosen])),
        }

    def table(self, horizons: Sequence[float]) -> dict[str, dict[str, float]]:
        """Rows at the horizons that the recordings reach, and of all readings."""
        near = {f"{x:g} s": np.abs(self.after - x) <= AROUND for x in horizons}
        rows = {name: self.row(chosen) for name, chosen in near.items() if chosen.any()}
        return rows | {"all": self.row(np.full(len(self.after), True))}


def joined(parts: Sequence[Predicted]) -> Predicted:
    """Readings of several recordings."""
    return Predicted(*(np.concatenate([getattr(p, x) for p in parts]) for x in ("after", "error", "half", "most")))


def of_recording(recording: StrikeRecording, found: RecordingFit) -> Predicted:
    """What the fit says of a held-out recording."""
    frames = found.channels[:, 0]
    first = recording.t[0] if found.predicted_from is None else recording.t[max(frames.min() - 1, 0)]
    scale = 1.0 if found.size is None else found.size
    return Predicted(
        recording.t[frames] - first, found.errors, scale * found.half_widths(0.5), scale * found.half_widths(0.9)
    )


def classes(found: Fit) -> dict[str, str]:
    """Class of each parameter."""
    return {p.name: p.kind for p in found.parameters}


def fold(given: Given, held: Sequence[int]) -> dict[str, Any]:
    """Fit all recordings but those that are held out, and predict these, as plain data."""
    began = time.perf_counter()
    inside = [r for i, r in enumerate(given.recordings) if i not in held]
    outside = [given.recordings[i] for i in held]
    swings = isinstance(given.plant.model, BareArm) and min(len(r.t) for r in outside) >= LEAST
    also = [from_middle(r) for r in outside] if swings else []
    found = fit(inside, given.plant, given.free, held_out=[*outside, *also], options=given.options)
    parts = [of_recording(r, f) for r, f in zip([*outside, *also], found.held_out, strict=True)]
    each = [{name: x.tolist() for name, x in asdict(part).items()} for part in parts]
    return {
        "seconds": time.perf_counter() - began,
        "classes": classes(found),
        "misfit_rms": float(np.sqrt(np.mean([r.rmse**2 for r in found.recordings]))),
        "values": {p.name: p.value for p in found.parameters},
        "predicted": each[: len(outside)],
        "from the middle": each[len(outside) :],
    }


def identity(given: Given) -> tuple[Any, ...]:
    """All on which fits of some recordings depend."""
    arrays = [x for r in given.recordings for x in (r.t, r.points, r.sigma, r.joints_t, r.joints_q, r.hand_pose)]
    digest = hashlib.sha256(b"".join(np.asarray(x, float).tobytes() for x in arrays if x is not None)).hexdigest()
    return digest, sorted(given.plant.values().items()), given.free, given.options


def study(given: Given, folder: Path | None = None) -> dict[str, Any]:
    """Fit each fold, predict what it left out; a folder keeps each fit."""
    of = identity(given)
    fits = [
        kept(folder, f"{given.name} fold {k}", (of, held), lambda held=held: fold(given, held))
        for k, held in enumerate(given.folds)
    ]
    parts, later = (
        [Predicted(**{key: np.array(x) for key, x in part.items()}) for one in fits for part in one[name]]
        for name in ("predicted", "from the middle")
    )
    first = [r for i, r in enumerate(given.recordings) if i not in given.folds[0]]
    starts = [fits[0]["classes"]]
    for k, other in enumerate(given.others):
        name, values = f"{given.name} start {k}", sorted(other.values().items())
        fitted = lambda other=other: classes(fit(first, other, given.free, options=given.options))  # noqa: E731
        starts.append(kept(folder, name, (of, given.folds[0], values), fitted))
    return {
        "recordings": len(given.recordings),
        "held_out": sum(map(len, given.folds)),
        "angular": isinstance(given.plant.model, BareArm),
        "predicted": joined(parts).table(given.horizons),
        "from the middle": joined(later).table(given.horizons) if later else {},
        "median of recordings": float(np.median([p.row(p.after <= WITHIN)["rms"] for p in parts])),
        "classes": starts[0],
        "misfit_rms": fits[0]["misfit_rms"],
        "values": fits[0]["values"],
        "starts": len(starts),
        "starts_that_agree": sum(x == starts[0] for x in starts),
        "seconds": float(np.median([one["seconds"] for one in fits])),
    }


def from_middle(swing: StrikeRecording) -> StrikeRecording:
    """The second half of a swing, whose first tenth is known: no choice was made by how well it is predicted."""
    half = {name: getattr(swing, name)[len(swing.t) // 2 :] for name in ("t", "points", "sigma", "t_points")}
    return replace(swing, **half, first_state=None)


def pendulum(folder: Path, name: str, *, quick: bool, whole: bool = False) -> Given:
    """The fits of the published pendulum; `whole`: its recordings are not cut, and one is held out at a time."""
    links, every, length = (1, 25, 3.0) if name == "single" else (2, 12, None)
    swings = [angles_from_hanging(r, every) for r in read_swings(folder / f"{name}.npz")]
    swings = swings if length is None or whole else [piece for r in swings for piece in cut(r, length)]
    count = len(swings) if whole else FOLDS
    folds = [list(range(k, len(swings), count)) for k in range(1 if quick else count)]
    sizes = [(0.2, 0.3)] if links == 1 else [(0.2, 0.2), (0.1, 0.2)]
    quantities = ("mass", "com", "inertia", "friction", "dry_friction", "drag", "zero", "length")
    left_out = {"link.length[1]"} if links == 2 else {"link.length[0]", "link.mass[0]", "link.com[0]"}
    free = tuple(n for q in quantities for i in range(links) if (n := f"link.{q}[{i}]") not in left_out)
    options = FitOptions(drive="free", pieces=(1.0, 3.0) if links == 1 else (0.3,))
    plant = bare_plant(sizes)
    rng, others = np.random.default_rng(0), []
    for _ in range(0 if quick or whole else OTHER_STARTS):
        drawn = {n: x * rng.uniform(0.6, 1.6) for n, x in plant.values().items() if n in free}
        others.append(plant.changed(drawn))
    title = f"{name} pendulum" + (", a whole recording at a time" if whole else "")
    return Given(title, swings, folds, plant, free, options, others=others)


def bare_plant(sizes: Sequence[tuple[float, float]]) -> Plant:
    """Uniform rods with these masses [kg] and lengths [m]."""
    return Plant(BareArm(ArmParameters(tuple(ArmLink(m, x) for m, x in sizes)), (1e-3,) * len(sizes)))


def angles_from_hanging(swing: StrikeRecording, every: int) -> StrikeRecording:
    """Every so many samples, counted from the angle that hangs in these files, pi; without the files' velocities."""
    points = swing.points[::every] - np.pi
    return StrikeRecording(swing.t[::every], points, swing.markers, 1e-3, source=swing.source)


def user_recordings(folder: Path) -> Given:
    """What `real.toml` of a folder names.

    Raises:
        InputError: A key is unknown or missing, or a value is not allowed.
    """
    file = folder / "real.toml"
    table = read_toml(file)
    for key in table:
        if key not in KEYS:
            raise InputError(f"{file}: {key}", table[key], "one of the keys " + ", ".join(KEYS))
    for key in ("recordings", "model", "free"):
        if key not in table:
            raise InputError(f"{file}: {key}", "nothing", "a value", f"keys are {', '.join(KEYS)}")
    for key in LISTS:
        if not isinstance(table.get(key, []), list):
            raise InputError(f"{file}: {key}", table[key], "a list")
    drive = table.get("drive", "command")
    names = each_episode([str(folder / x) for x in table["recordings"]])
    recordings = [tracked(opened(x, handle=drive == "handle"), name=x, tip=read_marker(None))[0] for x in names]
    held = held_out(table, names, file)
    if drive == "free":
        plant = Plant(read_bare_arm(folder / table["model"]))
    else:
        model = read_model(folder / table["model"])
        recordings = [r.for_model(model) for r in recordings]
        plant = Plant(model, (common_controller(recordings) or Controller()) if drive == "command" else None)
    free = tuple(full for x in table["free"] for full in (names_of(x, plant.values()) or [x]))
    kept = {key: table[key] for key in ("knots", "starts") if key in table}
    options = FitOptions(
        drive=drive, per_recording=tuple(table.get("per_recording", ())), pieces=tuple(table.get("pieces", ())), **kept
    )
    horizons = tuple(number(f"{file}: horizons", x, low=0, strict=True) for x in table.get("horizons", HORIZONS))
    return Given(folder.name, recordings, [held], plant, free, options, horizons)


def held_out(table: dict[str, Any], names: list[str], file: Path) -> list[int]:
    """Numbers of the recordings that a `real.toml` holds out."""
    if "each" in table:
        if table["each"] not in range(2, len(names) + 1):
            raise InputError(f"{file}: each", table["each"], f"a whole number from 2 to {len(names)}")
        return list(range(table["each"] - 1, len(names), table["each"]))
    found = []
    for x in table.get("held_out", [len(names) - 1]):
        match = [i for i, name in enumerate(names) if i == x or (isinstance(x, str) and name.endswith(x))]
        if len(match) != 1:
            raise InputError(f"{file}: held_out", x, f"numbers from 0 to {len(names) - 1} or names of recordings")
        found += match
    if not 0 < len(set(found)) < len(names):
        raise InputError(f"{file}: held_out", found, "some of the recordings, so that others are fitted")
    return found


def people(folder: Path, *, quick: bool) -> dict[str, Any]:
    """Peaks of markers along people's whip: fitted to discrete throws, predicted of rhythmic ones."""
    from whiptool.human import fit_cascade, measured, predicted, read_people

    seen = {style: measured(read_people(folder), style) for style in ("discrete", "rhythmic")}
    if quick:
        return {"markers": len(seen["discrete"].peaks)}
    best = fit_cascade(seen["discrete"])
    found = {}
    for style, one in seen.items():
        model = predicted(best.x, one.hand)
        if model is None:
            found[style] = "not predicted: the whip's simulation failed"
            continue
        found[f"{style}: peaks off by at most"] = float(np.abs(model.peaks / one.peaks - 1).max())
        found[f"{style}: times off by at most, of the throw"] = float(np.abs(model.times - one.times).max())
    return found


def studies(folder: Path, *, quick: bool, kept_in: Path | None = None) -> dict[str, Any]:
    """All studies of a folder by name, whose fits are kept in another one.

    Raises:
        InputError: The folder holds none of the files that are read.
    """
    found: dict[str, Any] = {}
    if (folder / "real.toml").is_file():
        given = user_recordings(folder)
        return {given.name: study(given, kept_in)}
    for name in ("single", "double"):
        if (folder / f"{name}.npz").is_file():
            from peers.plain_pendulum import plain_study

            for whole in (False, True)[: 1 + (name == "single" and not quick)]:
                given = pendulum(folder, name, quick=quick, whole=whole)
                found[given.name] = study(given, kept_in)

                def plain(given: Given = given) -> list[Any]:
                    return [[x.tolist() for x in part] for part in plain_study(given.recordings, given.folds)]

                parts = kept(kept_in, f"{given.name} plain", (identity(given), given.folds), plain)
                joint = joined([Predicted(*map(np.array, part)) for part in parts])
                found[given.name]["plain"] = joint.table(given.horizons)
    if any((folder / name).is_file() for name in ("trial_stats.csv", "WhipTask_TrialStats.csv")):
        seen = [file.stat().st_size for file in sorted(folder.iterdir())]
        thrown = partial(people, folder, quick=quick)
        found["people's throws"] = kept(kept_in, "people's throws", (seen, quick), thrown)
    if not folder.is_dir():
        raise InputError("FOLDER", str(folder), "a folder that exists", "docs/real-data.md says where the data are")
    if not found:
        rule = "a folder with real.toml, single.npz, double.npz or trial_stats.csv"
        raise InputError("FOLDER", str(folder), rule, "write a real.toml; --help shows one")
    return found


def print_study(name: str, found: dict[str, Any]) -> None:
    """A table for people."""
    if "predicted" not in found:
        said = {key: f"{value:.3g}" if isinstance(value, float) else value for key, value in found.items()}
        print(f"{name}: " + ", ".join(f"{key} {value}" for key, value in said.items()))
        return
    unit = "mrad" if found["angular"] else "mm"
    print(f"{name}: {found['held_out']} of {found['recordings']} recordings held out, fit {found['seconds']:.1f} s")
    for title, key in (("whiptool", "predicted"), ("from middle", "from the middle"), ("plain fit", "plain")):
        for horizon, row in found.get(key, {}).items():
            print(
                f"  {title:11s} {horizon:6s} RMS {1e3 * row['rms']:6.2f} {unit}, median {1e3 * row['median']:6.2f}; "
                f"50 % intervals hold {row['coverage_50']:.0%}, 90 % {row['coverage_90']:.0%}"
            )
    print(f"  RMS of a recording until {WITHIN:g} s: median {1e3 * found['median of recordings']:.2f} {unit}")
    zeros = ", ".join(f"{name} {1e3 * x:.2f} mrad" for name, x in found["values"].items() if ".zero[" in name)
    print(f"  fitted readings: RMS {1e3 * found['misfit_rms']:.2f} {unit}{'; ' if zeros else ''}{zeros}")
    print(f"  classes agree from {found['starts_that_agree']} of {found['starts']} starts")


def main() -> None:
    """Fit, predict and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="+", type=Path, metavar="FOLDER")
    parser.add_argument("--ropes", action="store_true", help="also the simulated ropes of benchmarks/ropes.py")
    parser.add_argument("--quick", action="store_true", help="one fit each, one rope, no dismech-newton")
    parser.add_argument("--json", action="store_true", help="one JSON object instead of tables")
    parser.add_argument("--folder", type=Path, help="keep each fit there, and go on where it was left")
    arguments = parser.parse_args()
    found: dict[str, Any] = {}
    with contextlib.redirect_stdout(sys.stderr):
        try:
            for folder in arguments.folders:
                new = studies(folder, quick=arguments.quick, kept_in=arguments.folder)
                if both := found.keys() & new.keys():
                    raise InputError(
                        "FOLDER", str(folder), f"other names of studies than {', '.join(both)}, given before"
                    )
                found |= new
        except InputError as error:
            parser.error(str(error))
        if arguments.ropes:
            import ropes

            few = arguments.quick
            found["ropes"] = ropes.study(1 if few else 5, arguments.folder, tuple(ropes.PEERS)[: 2 if few else 3])
    if arguments.json:
        print(json.dumps(found))
        return
    for name, one in found.items():
        if name == "ropes":
            print("simulated ropes:")
            ropes.print_study(one)
        else:
            print_study(name, one)


if __name__ == "__main__":
    main()
