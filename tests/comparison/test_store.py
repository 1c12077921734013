"""Results that are kept, and results of older versions."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from whiptool.comparison.units import Store, Unit, older_results

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
