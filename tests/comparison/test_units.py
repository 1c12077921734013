"""Keys of stored results: all fields of a unit and its kind are in it."""

from __future__ import annotations

import os
import pickle
import pkgutil
import re
import signal
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields, is_dataclass, replace
from importlib import import_module
from pathlib import Path
from types import UnionType
from typing import Any, Union, get_args, get_origin, get_type_hints

import numpy as np
import pytest

import papers
import whiptool.comparison
from whiptool.commands.compare import CompareOptions
from whiptool.comparison.units import KEY, Store, Unit, UnitFailed, older_results, plain_of, work_on
from whiptool.errors import InputError
from whiptool.goals.zone import Disc, Zone
from whiptool.impedance import ConstantImpedance, Controller
from whiptool.models import Model, preset

MODEL, CONTROLLER = preset("lemon2024"), Controller()
TWO: dict[Any, tuple[Any, Any]] = {  # values of each type that differ
    str: ("a", "b"),
    int: (1, 2),
    float: (0.5, 0.5000000000000001),
    bool: (False, True),
    Any: ("a", 0.5),
    Path: (Path("a"), Path("b")),
    type(None): (None, "a"),
    Model: (MODEL, MODEL.with_parameters({"whip.k": 0.5})),
    Controller: (CONTROLLER, Controller(ConstantImpedance())),
    Zone: (Disc(), Disc(radius=0.2)),
}


def first_of(hint: Any) -> Any:
    """A value of a type; an object's fields are not checked."""
    if hint in TWO:
        return TWO[hint][0]
    inner, kind = get_args(hint), get_origin(hint)
    if kind in (Union, UnionType):
        return first_of(inner[0])
    if kind is tuple:
        return tuple(first_of(x) for x in inner if x is not ...)
    if kind is Mapping:
        return {first_of(inner[0]): first_of(inner[1])}
    assert is_dataclass(hint), f"the test knows no two values of {hint}"
    made: Any = object.__new__(hint)
    for name, of in hints_of(hint).items():
        object.__setattr__(made, name, first_of(of))
    return made


def others_of(hint: Any) -> Iterator[tuple[str, Any]]:
    """Values that differ from the first, and where."""
    inner, kind = get_args(hint), get_origin(hint)
    if hint in TWO:
        yield "", TWO[hint][1]
    elif kind in (Union, UnionType):
        yield from others_of(inner[0])
        yield "", first_of(inner[1])
    elif kind is tuple:
        items = first_of(hint)
        yield from ((where, (other, *items[1:])) for where, other in others_of(inner[0]))
        yield "", (*items, items[-1])
    elif kind is Mapping:
        yield "", {}
        yield from ((where, {first_of(inner[0]): other}) for where, other in others_of(inner[1]))
    else:
        for name, of in hints_of(hint).items():
            for where, other in others_of(of):
                made = first_of(hint)
                object.__setattr__(made, name, other)
                yield f".{name}{where}", made


def hints_of(kind: type) -> dict[str, Any]:
    """Types of the fields that count."""
    hints = get_type_hints(kind)
    return {x.name: hints[x.name] for x in fields(kind) if x.compare}


def kinds() -> list[type[Any]]:
    """All units that there are."""
    for package in (whiptool.comparison, papers):
        for module in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
            import_module(module.name)

    def below(kind: type) -> Iterator[type]:
        for one in kind.__subclasses__():
            yield one
            yield from below(one)

    return [
        kind for kind in below(Unit) if kind.__module__.startswith(("whiptool.", "papers.")) and "run" in vars(kind)
    ]


@pytest.mark.slow  # it imports all of them
def test_every_field_of_every_unit_is_in_its_key():
    """Also what is in the fields of its fields, such as the hit radii of a scene."""
    assert len(kinds()) >= 20
    same = []
    for kind in kinds():
        assert all(x.compare for x in fields(kind)), kind
        key = first_of(kind).key
        assert key == first_of(kind).key
        same += [kind.__name__ + where for where, other in others_of(kind) if other.key == key]
    assert same == []


def test_the_test_looks_at_fields_of_fields():
    found = {kind.__name__ + where for kind in kinds() for where, _ in others_of(kind)}
    assert {"SearchUnit.scene.radii", "StrikeUnit.hit_radius", "RegionUnit.scene.cap"} <= found
    assert {"GoalsUnit.task.region.hit_radius", "GoalsUnit.kept.label", "LearnerUnit.settings"} <= found


def test_kinds_have_names_of_their_own():
    names = [kind.__name__ for kind in kinds()]
    assert len(set(names)) == len(names)


@dataclass(frozen=True, kw_only=True)
class Kept:
    label: str
    folder: str = field(default="here", compare=False)


@dataclass(frozen=True, kw_only=True)
class OneUnit(Unit):
    method: str
    trials: int = 600
    strike: Any = ()
    kept: Kept | None = None

    def run(self, folder: Path | None, threads: int | None) -> dict[str, Any]:
        return {}


class OtherUnit(OneUnit):
    pass


def test_a_key_is_fit_for_a_file_and_tells_people_what_it_is_of():
    key = OneUnit(method="nlopt:GN_CRS2/LM", trials=40).key
    assert re.fullmatch(r"one-nlopt_GN_CRS2_LM-trials40-[0-9a-f]{16}", key)
    assert KEY.search(key)
    assert not KEY.search("sac-goal-seed0")
    assert len(OneUnit(method="x" * 10_000).key) < 130
    assert OneUnit(method="x" * 10_000).key != OneUnit(method="x" * 10_001).key


def test_units_that_are_equal_have_one_key_wherever_they_are():
    one = OneUnit(method="ga", strike=(0.1, 2.0), kept=Kept(label="a"))
    assert pickle.loads(pickle.dumps(one)).key == replace(one).key == one.key
    assert replace(one, strike=[0.1, np.float64(2.0)]).key == one.key  # as JSON gives it back
    assert replace(one, kept=Kept(label="a", folder="moved")).key == one.key
    assert replace(one, kept=Kept(label="b")).key != one.key
    assert replace(one, strike=(0.1, 2.0000000000000004)).key != one.key
    assert OtherUnit(method="ga", strike=(0.1, 2.0), kept=Kept(label="a")).key != one.key


def test_arrays_count_by_their_numbers_and_shape():
    plain = [plain_of(np.array(x)) for x in ([1.0, 2.0], [[1.0, 2.0]], [1, 2], [1.0, 2.5], [1.0, 2.0])]
    assert plain[0] == plain[4]
    assert all(plain[0] != other for other in plain[1:4])


def test_what_has_no_plain_data_is_no_part_of_a_key():
    for wrong in (len, {1}, np.array([object()])):
        with pytest.raises(TypeError, match="no key can be made"):
            _ = OneUnit(method="ga", strike=wrong).key


RUNS: list[tuple[int, float]] = []


@dataclass(frozen=True, kw_only=True)
class CountedUnit(Unit):
    seed: int
    hit_radius: float

    def run(self, folder: Path | None, threads: int | None) -> dict[str, Any]:
        RUNS.append((self.seed, self.hit_radius))
        return {"radius": self.hit_radius}


def test_a_result_is_found_again_and_that_of_another_hit_radius_is_not(tmp_path):
    unit = CountedUnit(seed=0, hit_radius=0.06)
    RUNS.clear()
    first = Store(tmp_path).results([unit])
    assert Store(tmp_path).results([replace(unit)]) == first == {unit.key: {"radius": 0.06}}
    tighter = replace(unit, hit_radius=0.01)
    assert Store(tmp_path).results([tighter])[tighter.key] == {"radius": 0.01}
    assert RUNS == [(0, 0.06), (0, 0.01)]


def test_results_of_older_versions_are_not_used_and_one_line_says_so(tmp_path, capsys):
    unit = CountedUnit(seed=0, hit_radius=0.06)
    (tmp_path / "units").mkdir()
    for name in ("counted-0", "counted-seed1"):  # names that left out the hit radius
        (tmp_path / "units" / f"{name}.json").write_text('{"radius": 1}')
    assert Store(tmp_path).results([unit])[unit.key] == {"radius": 0.06}
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"whiptool: {tmp_path / 'units'}: 2 results of an older version")
    assert "computed again" in line
    assert Store(tmp_path).results([unit])[unit.key] == {"radius": 0.06}


def test_a_folder_of_new_results_is_not_called_old(tmp_path, capsys):
    Store(tmp_path).results([CountedUnit(seed=0, hit_radius=0.06)])
    Store(tmp_path)
    assert older_results(tmp_path / "units") == ""
    assert capsys.readouterr().err == ""


class DieOnce:
    """Work that kills its process the first `times` times that it meets the unit `bad`."""

    def __init__(self, marks: Path, times: int) -> None:
        self.marks, self.times = marks, times

    def __call__(self, unit: str) -> str:
        if unit == "bad" and len(list(self.marks.iterdir())) < self.times:
            (self.marks / f"{os.getpid()}-{time.monotonic_ns()}").touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return unit.upper()


@pytest.mark.parametrize("times", [1, 2])
def test_a_dead_worker_is_replaced_and_reported(tmp_path, times):
    units, deaths = {name: name for name in ("a", "b", "bad", "c", "d")}, []
    found = dict(work_on(units, DieOnce(tmp_path, times), workers=2, on_death=deaths.append))
    assert found == {name: name.upper() for name in units}
    assert 1 <= len(deaths) <= times
    assert all("bad" in names for names in deaths)


@pytest.mark.slow
def test_a_unit_that_kills_every_worker_is_given_up_after_the_others(tmp_path):
    units, found = {name: name for name in ("bad", "a", "b", "c")}, {}
    results = work_on(units, DieOnce(tmp_path, 99), workers=2)
    with pytest.raises(UnitFailed, match=r"^bad: 3 workers died"):
        found.update(results)
    assert set(found) == {"a", "b", "c"}


def test_no_more_processes_than_units_and_cores(monkeypatch, capsys):
    """100,000 workers are neither forked for two units nor on a machine with fewer cores."""
    asked = []

    class Full(Exception):
        pass

    def pool(max_workers, **_):
        asked.append(max_workers)
        raise Full

    monkeypatch.setattr("loky.ProcessPoolExecutor", pool)
    with pytest.raises(Full):
        dict(work_on({"a": 1, "b": 2}, _refuse, workers=100_000))
    assert asked == [2]
    cores = max(2, os.cpu_count() or 1)
    assert CompareOptions(workers=100_000).processes() == cores
    assert capsys.readouterr().err == f"whiptool: --workers 100000: {cores} are used, one per core\n"
    assert CompareOptions(workers=1).processes() == 1
    assert capsys.readouterr().err == ""


def _refuse(unit: str) -> str:

    raise InputError("whip.k", -1, "a number >= 0")


@pytest.mark.parametrize("count", [1, 2])
def test_a_units_own_error_comes_with_its_name(count):
    with pytest.raises(UnitFailed, match=r"^b: whip\.k: got -1"):
        dict(work_on({"b": 1}, _refuse, workers=count))
