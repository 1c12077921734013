"""Hostile inputs of files, options, run folders and Python, the same for the same seed, and how an answer is judged.

A file is right if it is read or refused in one line, a command if it ends with a status of its own and no traceback,
and a call of Python if it returns, refuses the argument, or does not take such an argument at all.
"""

from __future__ import annotations

import contextlib
import dataclasses
import io
import json
import math
import os
import random
import re
import shutil
import tomllib
import traceback
from collections.abc import Callable, Iterator, Sequence
from datetime import date
from decimal import Decimal
from fractions import Fraction
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w
from forked import Input
from lab_files import FORMATS, swing
from recordings import full
from repository import ROOT
from robot_files import MJCF, URDF
from robot_log_files import write_libfranka, write_rtde

import whiptool
from whiptool.errors import WhiptoolError

OLDER = ROOT / "tests" / "data" / "written_by_early_0_2_0"
HUGE = 10**400


class Accepted(BaseException):
    """A command has accepted its input, and begins to compute."""


# --- judging ---------------------------------------------------------------------------------------------------------


def refusal(error: BaseException) -> str:
    """Return what is wrong with an error that a call ended with; empty: it is a refusal."""
    if isinstance(error, Accepted):
        return ""
    if isinstance(error, WhiptoolError):
        return "" if "\n" not in str(error) else f"several lines: {error}"
    if isinstance(error, OSError) and error.filename is not None:
        return ""  # a path that cannot be written
    if isinstance(error, TypeError | AttributeError) and _outermost(error):
        return ""  # the function takes no such argument, the object has no such attribute
    return "".join(traceback.format_exception(error))[-3000:]


def _outermost(error: BaseException) -> bool:
    """Whether an error was raised by the call itself, not within the library."""
    frames = traceback.extract_tb(error.__traceback__)
    return all("/whiptool/" not in frame.filename for frame in frames)


def called(call: Callable[[], object]) -> str:
    try:
        call()
    except BaseException as error:
        return refusal(error)
    return ""


def commanded(main: Callable[[list[str]], int], words: list[str]) -> str:
    """Return what is wrong with how a command ends; empty: it is done, refused, or about to compute."""
    out, err = io.StringIO(), io.StringIO()
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            status = main(words)
    except SystemExit as end:
        return "" if end.code in (0, None) else f"SystemExit({end.code})"
    except BaseException as error:
        return refusal(error)
    said = err.getvalue()
    if "Traceback" in said:
        return said[-3000:]
    if status not in (0, 1, 2, 3):
        return f"status {status}: {said[-500:]}"
    if status == 2 and not (said.rstrip("\n").rpartition("\n")[2].startswith("whiptool: ") and len(said) < 20_000):
        return f"status 2 without a line that says why: {said[-500:]}"
    return ""


# --- values ----------------------------------------------------------------------------------------------------------

NUMBERS = (
    -1, 0, 1, 2, 1e308, -1e308, 1e-320, 1e16, 10**9, 2**63, 2**64, math.nan, math.inf, -math.inf, -0.0, HUGE, -HUGE, 0.5
)  # fmt: skip
TEXTS = ("", " ", "x", "1.0", "1_0", "nan", "\u0661", "\n", "é" * 5000, "../..", "/dev/zero", "{x}", "%s", "'\"\\")


class _Evil:
    """Raises at whatever it is asked."""

    def __repr__(self) -> str:
        raise RuntimeError("no name")

    def __array__(self, *_: object, **__: object) -> np.ndarray:
        raise RuntimeError("no array")

    def __len__(self) -> int:
        raise RuntimeError("no length")

    def __iter__(self) -> Iterator[float]:
        raise RuntimeError("no values")

    def __float__(self) -> float:
        raise RuntimeError("no number")


def python_values() -> list[Any]:
    """Values that a user may give by mistake, new at every call: some are used up."""
    import pandas as pd
    import torch

    deep: list[Any] = []
    for _ in range(2000):
        deep = [deep]
    round_: list[Any] = [1.0]
    round_.append(round_)
    return [
        None, True, False, 1j, *NUMBERS, *TEXTS, b"bytes", (), [], {}, set(), [[]], [None], [1, "a"], [1.0, [2.0]],
        [1.0], [1.0, 2.0], [math.nan, 0.0], (HUGE, 0.0), ["x"], [""], {"x": 1}, {1: 2}, {"whip.k": math.nan}, {"a"},
        np.array(1.0), np.array(0), np.array("x"), np.array(None), np.zeros(0), np.zeros((0, 2)), np.zeros((3, 0)),
        np.zeros((2, 2, 2, 2)), np.array([None]), np.array([1, "a"], object), np.array(["a", "b"]), np.ones(3, complex),
        np.ones(2, bool), np.array([np.nan, 1.0]), np.array([1e308, 1e308]), np.float32("nan"), np.float64(0),
        np.datetime64("2020-01-01"), np.timedelta64(3, "s"), np.ma.masked_array([1.0, 2.0], [True, False]),
        np.zeros(2, [("a", float)]), np.bytes_(b"x"), np.void(b"x"), np.random.default_rng(0), np.random,
        (x for x in (1.0, 2.0)), iter([1.0]), range(3), map(float, ["1"]), zip([1], [2]), lambda: 1.0, object(), type,
        int, ..., NotImplemented, slice(1, 2), Decimal("1.5"), Decimal("nan"), Fraction(1, 3), date(2020, 1, 1),
        Path("none"), Path(), Path("/dev/zero"), Path("x\0y"), deep, round_, _Evil(), [_Evil()], Exception("x"),
        torch.ones(2, requires_grad=True), torch.tensor(1.0, requires_grad=True), torch.ones(2, device="meta"),
        torch.ones(2, dtype=torch.bfloat16), pd.Series([1.0, None]),
        pd.DataFrame({"a": [1.0]}), pd.NA, pd.NaT, memoryview(b"abc"), bytearray(b"abc"), io.StringIO("x"),
    ]  # fmt: skip


PLAIN = [*NUMBERS[:-1], True, False, *TEXTS, [], {}, [[]], [1.0], [1.0, 2.0], ["x"], [[1.0], [1.0, 2.0]], {"x": 1}]
PLAIN += [[0.0] * 1000, {"a": {"b": {}}}, [{}], [math.nan, math.nan], [[]] * 50, "9" * 5000]
WORDS = (
    "nan", "inf", "-inf", "-1", "0", "1", "2", "1e308", "1e-320", "1e16", f"1{'0' * 400}", "9" * 5000, "", " ", "x",
    "1,2", "1,,2", "--", "-x", "=", "none", "None", "true", "\x00", "\udcff", "/dev/zero", "/dev/null", ".", "..", "/",
    "pipe", "folder", "loop", "empty", "garbage.npz", "0x10", "1_0", "1.5", "99999999999", "NaN", "{}", "[]", "a=b",
    "=1", "shoulder=1", "\n", "*", "~", "http://x", "ur://", "twin", "x" * 300, "#3", "good.toml#2", "-0",
)  # fmt: skip


def replaced(content: Any, rng: random.Random, values: Sequence[Any] = PLAIN) -> Any:
    """Return nested plain data with something within it replaced, left out or added."""
    content = json.loads(json.dumps(content, default=str))
    places = list(_places(content))
    if not places or rng.random() < 0.03:
        return rng.choice(values)
    for _ in range(rng.choice((1, 1, 1, 2))):
        inside, key = rng.choice(places)
        with contextlib.suppress(KeyError, IndexError):
            how = rng.random()
            if how < 0.1:
                del inside[key]
            elif how < 0.2 and isinstance(inside, dict):
                inside[rng.choice(("x", "", "é", "a.b"))] = rng.choice(values)
            elif how < 0.3 and isinstance(inside, list):
                inside.append(inside[key])
            else:
                inside[key] = rng.choice(values)
    return content


def _places(content: Any) -> Iterator[tuple[Any, Any]]:
    keys = content if isinstance(content, dict) else range(len(content)) if isinstance(content, list) else ()
    for key in list(keys):
        yield content, key
        yield from _places(content[key])


def damaged(data: bytes, rng: random.Random) -> bytes:
    """Return bytes that are cut off, changed, repeated or replaced."""
    how = rng.randrange(7)
    n = max(1, len(data))
    if how == 0:
        return data[: rng.randrange(n)]
    if how == 1:
        return rng.randbytes(rng.randrange(600))
    if how == 2:
        at = rng.randrange(n)
        return data[:at] + data[rng.randrange(n) :]
    if how == 3:
        return data[: rng.choice((16, 128, 512))] + rng.randbytes(300)
    made = bytearray(data or b"x")
    for _ in range(rng.choice((1, 3, 30))):
        made[rng.randrange(min(len(made), rng.choice((200, 2000, 10**9))))] = rng.randrange(256)
    return bytes(made)


_TOKEN = re.compile(rb"[-+\w.]+")


def reworded(data: bytes, rng: random.Random) -> bytes:
    """Return a text with some of its words or numbers replaced."""
    words = list(_TOKEN.finditer(data[:200_000]))
    if not words:
        return data
    for match in sorted(rng.sample(words, min(len(words), rng.choice((1, 1, 2, 5)))), key=lambda m: -m.start()):
        new = rng.choice([*WORDS, *WORDS[:12]]).encode("utf-8", "surrogatepass")
        data = data[: match.start()] + new + data[match.end() :]
    return data


def put_kind(path: Path, rng: random.Random) -> str:
    """Put something that is no file in a place, and return what."""
    if path.is_dir():
        shutil.rmtree(path)
    path.unlink(missing_ok=True)
    kind = rng.choice(("pipe", "folder", "loop", "nothing", "empty", "device", "sparse", "unreadable", "full", "long"))
    match kind:
        case "pipe":
            os.mkfifo(path)
        case "folder":
            path.mkdir()
        case "loop":
            path.symlink_to(path.name)
        case "nothing":
            path.symlink_to("nowhere")
        case "empty":
            path.touch()
        case "device":
            path.symlink_to("/dev/zero")
        case "sparse":
            with path.open("wb") as file:
                file.truncate(3 << 30)
        case "unreadable":
            path.write_text("x")
            path.chmod(0)
        case "full":
            path.symlink_to("/dev/full")
        case "long":
            path.write_bytes(b"[" * 3_000_000)
    return kind


def as_toml(table: Any) -> bytes:
    try:
        return tomli_w.dumps(table).encode("utf-8", "surrogatepass")
    except (TypeError, ValueError, AttributeError):
        return repr(table).encode("utf-8", "surrogatepass")


def changed(data: bytes, kind: str, rng: random.Random) -> bytes:
    """Return a file's content changed as data of its kind, as words, or as bytes."""
    how = rng.random()
    if how < 0.6 and kind in ("toml", "json"):
        text = data.decode()
        table = tomllib.loads(text) if kind == "toml" else json.loads(text)
        table = replaced(table, rng)
        return as_toml(table) if kind == "toml" else json.dumps(table).encode("utf-8", "surrogatepass")
    if how < 0.85 and kind in ("toml", "json", "csv", "xml", "text"):
        return reworded(data, rng)
    return damaged(data, rng)


# --- files -----------------------------------------------------------------------------------------------------------


def model_inputs(count: int, seed: int) -> Iterator[Input]:
    """Files of models, robots and controllers."""
    bases = {path.name: path.read_bytes() for path in sorted((OLDER / "files").glob("*.toml"))}
    bases |= {"robot.urdf": URDF.encode(), "robot.xml": MJCF.encode()}
    names = [name for name in bases if not name.startswith("cameras")]
    for i in range(count):
        rng = random.Random(f"model {seed} {i}")
        name = rng.choice([*names, *["robot.urdf"] * 4, *["robot.xml"] * 4])
        yield Input(f"model {i} {name}", lambda folder, n=name, r=rng: _of_model(folder / n, bases[n], r))


def _of_model(path: Path, data: bytes, rng: random.Random) -> str:
    kind = {".toml": "toml"}.get(path.suffix, "xml")
    if rng.random() < 0.1:
        put_kind(path, rng)
    else:
        path.write_bytes(changed(data, kind, rng))
    from whiptool.impedance.controller import read_controller

    reader = read_controller if path.name.startswith("controller") else whiptool.load_model
    return called(lambda: _used(reader(path if reader is read_controller else str(path))))


def _used(read: Any) -> None:
    """Use a model in what needs no compiled engine."""
    if not isinstance(read, whiptool.Model):
        return
    whiptool.default_bounds(read.arm).sample(np.random.default_rng(0), 3)
    controller = whiptool.default_controller(read)
    controller.check_fits(read.arm)
    whiptool.write_model(read, "again.toml")
    whiptool.read_model("again.toml")
    whiptool.Objective(whiptool.CompiledRollout(read, controller))


@cache
def _recordings() -> dict[str, tuple[bytes, str]]:
    """Content and name of a recording in every format that one file holds."""
    import tempfile

    found = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for format_, (file, write, packages) in FORMATS.items():
            try:
                [__import__(package) for package in packages]
                write(folder / file, swing())
            except ImportError:
                continue
            found[format_] = (folder / file).read_bytes(), file
        full().save(folder / "a.npz")
        write_rtde(folder / "rtde.csv")
        write_libfranka(folder / "franka.csv")
        from whiptool.recording.readers import write_csv

        write_csv(full(), folder / "own.csv")
        for file in ("a.npz", "rtde.csv", "franka.csv", "own.csv"):
            found[file] = (folder / file).read_bytes(), file
        found["own sidecar"] = (folder / "own.toml").read_bytes(), "own.toml"
    return found


TEXT_ENDINGS = (".csv", ".tsv", ".trc", ".txt")


def recording_inputs(count: int, seed: int) -> Iterator[Input]:
    """Files of recordings, and their sidecars."""
    bases = _recordings()
    slow = {name for name, (_, file) in bases.items() if file.endswith((".mat", ".c3d"))}  # read in another process
    for i in range(count):
        rng = random.Random(f"recording {seed} {i}")
        name = rng.choice([x for x in bases if x not in slow or i % 40 == 0])
        yield Input(f"recording {i} {name}", lambda folder, n=name, r=rng: _of_recording(folder, *bases[n], r))


def _of_recording(folder: Path, data: bytes, file: str, rng: random.Random) -> str:
    path = folder / file
    sidecar = file == "own.toml" or rng.random() < 0.25
    if sidecar:
        content, file = (_recordings()["own.csv"][0], "own.csv") if path.suffix == ".toml" else (data, file)
        (folder / file).write_bytes(content)
        path = (folder / file).with_suffix(".toml")
        data, kind = _recordings()["own sidecar"][0], "toml"
    else:
        kind = "csv" if path.suffix in TEXT_ENDINGS else "binary"
    if rng.random() < 0.07:
        put_kind(path, rng)
    else:
        path.write_bytes(changed(data, kind, rng))
    if rng.random() < 0.3:
        from whiptool.commands.recording import main

        return commanded(main, ["show", str(folder / file), "--json"])
    return called(lambda: whiptool.read_recording(folder / file))


def stored_inputs(count: int, seed: int) -> Iterator[Input]:
    """Other files: policies, maps, libraries, trajectories, cameras, beliefs."""
    for i in range(count):
        rng = random.Random(f"stored {seed} {i}")
        which = rng.choice(list(STORED))
        yield Input(f"stored {i} {which}", lambda folder, w=which, r=rng: _of_stored(folder, w, r))


def _policy(path: Path) -> None:
    whiptool.load_policy(path.parent)


def _map(path: Path) -> None:
    whiptool.load_map(path.parent)


def _trajectory(path: Path) -> None:
    whiptool.Trajectory.load(path)


def _joints(path: Path) -> None:
    from whiptool.models.joint_trajectory import JointTrajectory

    JointTrajectory.read(path)


def _cameras(path: Path) -> None:
    from whiptool.recording.camera import read_cameras

    read_cameras(path)


def _library(path: Path) -> None:
    from whiptool.comparison.search_unit import StrikeLibrary

    StrikeLibrary.load(path)


def _region(path: Path) -> None:
    from whiptool.goals.zone import Region

    Region.load(path)


def _bare_arm(path: Path) -> None:
    from whiptool.identification.plant import read_bare_arm

    read_bare_arm(path)


def _cycles(path: Path) -> None:
    from whiptool.rig.cyclelog import Cycles

    Cycles.load(path)


def _recording(path: Path) -> None:
    whiptool.read_recording(path)


STORED: dict[str, Callable[[Path], None]] = {
    "train/checkpoint.pt": _policy,
    "train/config.toml": _policy,
    "train-paper/checkpoint.pt": _policy,
    "map/answers-000.npz": _map,
    "map/config.toml": _map,
    "map/result.json": _map,
    "simulate-short/trajectory.npz": _trajectory,
    "files/joints.csv": _joints,
    "files/cameras.toml": _cameras,
    "files/library.npz": _library,
    "files/region.npz": _region,
    "files/region-space.npz": _region,
    "files/pendulum.toml": _bare_arm,
    "rig/cycles.log": _cycles,
    "files/recording.npz": _recording,
    "files/swing.npz": _recording,
}


def _of_stored(folder: Path, which: str, rng: random.Random) -> str:
    path = shutil.copytree((OLDER / which).parent, folder / "kept") / Path(which).name
    _spoil(path, rng)
    return called(lambda: STORED[which](path))


def _spoil(path: Path, rng: random.Random) -> str:
    if rng.random() < 0.15:
        return put_kind(path, rng)
    kind = {".toml": "toml", ".json": "json", ".csv": "csv"}.get(path.suffix, "binary")
    path.write_bytes(changed(path.read_bytes(), kind, rng))
    return "changed"


# --- run folders -----------------------------------------------------------------------------------------------------

RUNS: dict[str, Sequence[tuple[str, ...]]] = {
    "optimize": (
        ("simulate", "RUN"),
        ("optimize", "--resume", "RUN"),
        ("view", "RUN", "--json"),
        ("studio", "RUN", "M"),
    ),
    "optimize-pareto": (("simulate", "RUN"), ("optimize", "--resume", "RUN"), ("view", "RUN", "--json")),
    "simulate-short": (("view", "RUN", "--json"), ("simulate", "RUN")),
    "train": (("train", "--resume", "RUN"), ("view", "RUN", "--json"), ("simulate", "RUN"), ("studio", "RUN", "M")),
    "compare": (("compare", "--resume", "RUN"), ("view", "RUN", "--json")),
    "adapt": (("adapt", "--resume", "RUN"), ("view", "RUN", "--json"), ("studio", "RUN", "M")),
    "adapt-robot": (("adapt", "next", "--run", "RUN"), ("adapt", "--resume", "RUN")),
    "identify": (("identify", "--resume", "RUN"), ("view", "RUN", "--json")),
    "identify-free": (("identify", "--resume", "RUN"), ("view", "RUN", "--json")),
    "map": (("map", "strike", "RUN", "--target", "1.25", "0.05"), ("view", "RUN", "--json"), ("studio", "RUN", "M")),
    "rig": (("view", "RUN", "--json"), ("studio", "RUN", "M")),
    "rig-learn": (("rig", "learn", "--resume", "RUN"), ("view", "RUN", "--json")),
}


def run_folder_inputs(count: int, seed: int) -> Iterator[Input]:
    """Run folders of which a file is damaged, and commands that go on with them or show them."""
    for i in range(count):
        rng = random.Random(f"run folder {seed} {i}")
        run = rng.choice(list(RUNS))
        words = rng.choice(RUNS[run])
        yield Input(
            f"run folder {i} {' '.join(words).replace('RUN', run)}", lambda f, a=(run, words, rng): _of_run(f, *a)
        )


def _of_run(folder: Path, run: str, words: Sequence[str], rng: random.Random) -> str:
    shutil.copytree(OLDER / run, folder / run)
    for name in ("recording.npz", "swing.npz", "pendulum.toml"):
        shutil.copy(OLDER / "files" / name, folder)
    path = rng.choice(sorted(path for path in (folder / run).rglob("*") if path.is_file()))
    if rng.random() < 0.25:
        path = path.with_name(rng.choice(("result.json", "config.toml", "episodes.csv", "trials.csv", ".lock")))
    _spoil(path, rng) if path.is_file() else put_kind(path, rng)
    ends = {"RUN": [run], "M": ["--mcap", "shown.mcap"]}
    given = [x for word in words[1:] for x in ends.get(word, [word])]
    return _with_what_is(path, commanded(_main(words[0]), given))


def _with_what_is(path: Path, wrong: str) -> str:
    if not wrong:
        return ""
    with contextlib.suppress(OSError):
        if path.is_file() and path.stat().st_size < 10**6 and path.suffix in (".json", ".toml", ".csv"):
            return f"{path}: {path.read_bytes()[:300]!r}\n{wrong}"
    return f"{path}: {wrong}"


def _main(command: str) -> Callable[[list[str]], int]:
    from whiptool.commands.cli import main_of

    return main_of(command)


def accept(*_: object, **__: object) -> Any:
    """Take the place of what computes: the input was accepted."""
    raise Accepted


def computing() -> list[tuple[Any, str]]:
    """Return what rolls out, trains, serves or starts processes, as modules or classes with a name."""
    import viser

    from whiptool.commands import emulators, following
    from whiptool.comparison import units
    from whiptool.identification import predict
    from whiptool.rig import child_process
    from whiptool.rollout import compiled, reference

    return [
        (compiled, "find_engine"),
        (predict, "find_engine"),
        (reference.ReferenceRollout, "trajectory"),
        (units, "work_on"),
        (child_process.Emulated, "__init__"),
        (following, "serve_until_stopped"),
        (following, "watch"),
        (viser, "ViserServer"),
        (emulators, "_serve_servos"),
        (emulators, "_serve_ur"),
    ]


# --- options ---------------------------------------------------------------------------------------------------------

COMMANDS: dict[str, tuple[str, str, Sequence[str]]] = {  # module and class of the options, and words that are needed
    "optimize": ("whiptool.commands.optimize", "OptimizeOptions", ()),
    "simulate": ("whiptool.commands.simulate", "SimulateOptions", ("--strike", "-0.6", "0.2", "0.7", "2.1", "1.2")),
    "train": ("whiptool.commands.train", "TrainOptions", ()),
    "map build": ("whiptool.commands.map", "BuildOptions", ()),
    "map strike": ("whiptool.commands.map", "MapStrikeOptions", ("map",)),
    "compare": ("whiptool.commands.compare", "CompareOptions", ()),
    "reproduce": ("papers.reproduce", "ReproduceOptions", ("fig6",)),
    "adapt": ("whiptool.commands.adapt", "AdaptOptions", ()),
    "adapt next": ("whiptool.commands.adapt", "NextOptions", ("--run", "adapt-robot")),
    "human": ("papers.human.command", "HumanOptions", ("folder",)),
    "identify": ("whiptool.commands.identify", "IdentifyOptions", ("good.npz",)),
    "view": ("whiptool.commands.view", "ViewOptions", ("simulate-short",)),
    "recording show": ("whiptool.commands.recording", "ShowOptions", ("good.npz",)),
    "recording convert": ("whiptool.commands.recording", "ConvertOptions", ("good.npz", "new.csv")),
    "studio": ("whiptool.commands.studio", "StudioOptions", ()),
    "rig strike": ("whiptool.commands.rig", "RigStrikeOptions", ("--port", "/dev/nowhere", "--camera", "none")),
    "rig learn": ("whiptool.commands.rig", "LearnOptions", ("--port", "/dev/nowhere")),
    "robot strike": ("whiptool.commands.robot", "RobotOptions", ("--robot", "ur://127.0.0.1:9")),
    "robot recover": ("whiptool.commands.robot", "RecoverOptions", ("--robot", "ur://127.0.0.1:9")),
    "dynamixel": ("whiptool.commands.servos", "ServoOptions", ("--port", "/dev/nowhere")),
    "emulator": ("whiptool.commands.emulators", "EmulatorOptions", ()),
    "ur_emulator": ("whiptool.commands.emulators", "UrEmulatorOptions", ()),
}


def option_inputs(count: int, seed: int) -> Iterator[Input]:
    """Options of all commands with hostile values."""
    from importlib import import_module

    flags = []
    for command, (module, name, _) in COMMANDS.items():
        options = getattr(import_module(module), name)
        flags += [(command, "--" + f.name.replace("_", "-")) for f in dataclasses.fields(options)]
    random.Random(f"options {seed}").shuffle(flags)
    for i in range(count):
        rng = random.Random(f"option {seed} {i}")
        command, flag = flags[i % len(flags)]
        values = [rng.choice(WORDS) for _ in range(rng.choice((1, 1, 1, 2, 2, 3, 5, 0)))]
        words = [flag, *values]
        if rng.random() < 0.15:  # and another option of the same command
            words += [rng.choice([f for c, f in flags if c == command]), rng.choice(WORDS)]
        said = " ".join(words).encode("ascii", "backslashreplace").decode()[:150]
        yield Input(f"option {i} {command} {said}", lambda f, c=command, w=words: _of_option(f, c, w))


def _of_option(folder: Path, command: str, words: list[str]) -> str:
    _furnish(folder)
    name, *sub = command.split()
    return commanded(_main(name), [*sub, *COMMANDS[command][2], *words])


def _furnish(folder: Path) -> None:
    """Put what the words of options name into a folder."""
    for run in ("map", "adapt-robot", "simulate-short"):
        shutil.copytree(OLDER / run, folder / run)
    shutil.copy(OLDER / "files" / "recording.npz", folder / "good.npz")
    shutil.copy(OLDER / "files" / "model-lemon2024.toml", folder / "good.toml")
    (folder / "garbage.npz").write_bytes(bytes(range(256)))
    (folder / "folder").mkdir()
    (folder / "empty").touch()
    (folder / "loop").symlink_to("loop")
    os.mkfifo(folder / "pipe")


# --- Python ----------------------------------------------------------------------------------------------------------


def python_inputs(count: int, seed: int, calls: Sequence[tuple[Callable, dict[str, Any]]]) -> Iterator[Input]:
    """Calls with one or two wrong arguments, too many, or too few.

    Args:
        calls: Callables, each with arguments that are right.
    """
    kinds = len(python_values())
    pairs = [(call, right, name, k) for call, right in calls for name in right for k in range(kinds)]
    random.Random(f"calls {seed}").shuffle(pairs)
    for i, (call, right, name, k) in enumerate(pairs[:count]):
        label = f"python {i} {getattr(call, '__qualname__', call)}({name}=value {k})"
        yield Input(label, lambda _, a=(call, right, name, k, i): _of_call(*a))


def _of_call(call: Callable, right: dict[str, Any], name: str, k: int, i: int) -> str:
    rng = random.Random(f"call {i}")
    given = {**right, name: python_values()[k]}
    if rng.random() < 0.15:
        given[rng.choice(list(right))] = rng.choice(python_values())
    if rng.random() < 0.03:
        given["magic"] = 3
    wrong = called(lambda: call(**given))
    return wrong and f"{type(given[name]).__name__}: {wrong}"


def inputs(counts: dict[str, int], seed: int, calls: Sequence[tuple[Callable, dict[str, Any]]]) -> list[Input]:
    """Return inputs of each kind, as many as are asked for."""
    made = {
        "model": model_inputs,
        "recording": recording_inputs,
        "stored": stored_inputs,
        "run folder": run_folder_inputs,
        "option": option_inputs,
        "python": lambda count, seed: python_inputs(count, seed, calls),
    }
    return [one for kind, count in counts.items() for one in made[kind](count, seed)]
