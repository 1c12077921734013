"""The tool that tries mutants: what it changes, what it leaves alone, that it draws, keeps and restores."""

from __future__ import annotations

import subprocess
import sys
import tomllib

import pytest
from repository import ROOT

pytest.importorskip("cosmic_ray")
sys.path.insert(0, str(ROOT))

from tools.mutants.population import mutate, places, sample
from tools.mutants.results import Result, Store, interval
from tools.mutants.trials import Broken, Copy

MODULE = '''
import math
from dataclasses import dataclass
Number = int | float

@dataclass(frozen=True)
class Thing:
    size: float = 3.0 + 1.0

def area(r: int | float, *, scale: float = 2.0) -> float:
    """Of a disc, 3 + 4."""
    if r < 0:
        raise ValueError(f"r: {r + 1}")
    return scale * math.cos(r)**2 - 1

def other(x):
    return x + 1
'''
TESTS = """
from formulas.area import area, other
def test_area():
    assert abs(area(0.5) - 0.5403023058681398) < 1e-9
"""


@pytest.fixture
def project(tmp_path):
    root = tmp_path / "project"
    for name, text in (("formulas/area.py", MODULE), ("test_area.py", TESTS), ("whiptool/__init__.py", "")):
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(text)
    subprocess.run(["git", "init", "-q", str(root)], check=True)
    return root


def test_modules_and_their_tests_are_files():
    packages = tomllib.loads((ROOT / "tools" / "mutants" / "modules.toml").read_text())
    for modules in packages.values():
        for module, tests in modules.items():
            assert tests
            assert all((ROOT / name).is_file() for name in (module, *tests)), module


def test_only_formulas_are_changed(project):
    lines = {place.line for place in places(project, "formulas/area.py")}
    assert lines == {"return scale * math.cos(r)**2 - 1", "return x + 1"}
    scopes = {place.scope for place in places(project, "formulas/area.py")}
    assert scopes == {"area", "other"}


def test_every_mutant_is_another_program(project):
    becomes = {
        mutant.becomes
        for place in places(project, "formulas/area.py")
        for mutant in (mutate(project, place, change) for change in place.changes)
    }
    for wanted in ("scale / math.cos(r)**2 - 1", "scale * math.sin(r)**2 - 1", "scale * math.cos(r)**2 + 1"):
        assert f"return {wanted}" in becomes
    assert "return x - 1" in becomes


def test_larger_samples_hold_smaller_ones_and_seeds_differ(project):
    few, more = (sample(project, ["formulas/area.py"], count, 0) for count in (3, 6))
    assert [mutant.name for mutant in more[:3]] == [mutant.name for mutant in few]
    assert len({mutant.place for mutant in more}) == 6
    other = sample(project, ["formulas/area.py"], 6, 1)
    assert [mutant.name for mutant in other] != [mutant.name for mutant in more]
    path = project / "formulas" / "area.py"
    path.write_text("# a line more\n" + path.read_text())
    places.cache_clear()
    assert [mutant.name for mutant in sample(project, ["formulas/area.py"], 6, 0)] == [mutant.name for mutant in more]


@pytest.mark.slow
def test_trials_kill_and_leave_the_tree_alone(project, tmp_path):
    copy = Copy.of(project, tmp_path / "copy")
    before = (project / "formulas" / "area.py").read_text()
    verdicts = {}
    for mutant in sample(project, ["formulas/area.py"], 4, 0):
        survived, by, _ = copy.survives(mutant, ("test_area.py",))
        verdicts[mutant.place.scope] = survived
        assert survived == (mutant.place.scope == "other")
        assert survived or "test_area" in by
        assert (tmp_path / "copy" / "tree" / "formulas" / "area.py").read_text() == before
    assert (project / "formulas" / "area.py").read_text() == before
    (project / "test_area.py").write_text(TESTS.replace("0.54", "0.55"))
    broken = Copy.of(project, tmp_path / "broken")
    with pytest.raises(Broken, match="without a mutant"):
        broken.survives(mutant, ("test_area.py",))


def test_results_outlive_a_kill_in_the_middle_of_a_line(tmp_path):
    path = tmp_path / "results.jsonl"
    store = Store(path)
    for name, survived in (("a", False), ("b", True)):
        store.add(Result(name, "state", survived, "", 1.0))
    path.write_text(path.read_text() + '{"mutant": "c", "sta')
    again = Store(path)
    again.add(Result("d", "state", False, "timeout", 2.0))
    known = Store(path)._known
    assert {name for name, _ in known} == {"a", "b", "d"}
    assert known["d", "state"].by == "timeout"


def test_intervals_are_clopper_and_pearsons():
    assert interval(90, 100) == f"{0.9:8.2f}  0.82 to 0.95"
    assert interval(20, 20) == f"{1:8.2f}  0.83 to 1.00"
