"""A strike and a search on the twin from the command line: recordings, refusals, resumed runs."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from pretended_rig import Pretend

import whiptool as wt
from whiptool.commands.rig import main
from whiptool.commands.view import main as view_main
from whiptool.recording.readers import read_recording

pytest.importorskip("dynamixel_sdk")
pytest.importorskip("cv2")


STRIKE = wt.Strike.from_vector([-0.622, 0.221, 0.705, 2.122, 1.176])  # within the XM430's line, hits (1.2, 0.1)
WORDS = ["--strike", *map(str, STRIKE.vector), "--target", "1.2", "0.1"]


@pytest.mark.slow
def test_a_strike_leaves_a_recording_that_identification_reads(tmp_path: Path, capsys) -> None:
    out = tmp_path / "run"
    soon = ["--approach-speed", "1", "--settle", "0.2"]
    assert main(["strike", *WORDS, "--camera", "points", *soon, "--json", "--out", str(out)]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["fault"] is None
    assert summary["torque_off"]
    assert summary["missed"] == 0
    assert 0 < summary["miss_error"] < 0.01
    assert abs(summary["miss_distance"] - summary["true_miss_distance"]) < 4 * summary["miss_error"]
    assert summary["hit"] == (summary["hit_probability"] >= 0.9)
    report = Path(summary["report"]).read_text(encoding="utf-8")
    assert f"hit probability {summary['hit_probability']:.0%}" in report
    assert all((out / f"{name}.png").stat().st_size > 5000 for name in ("strike", "servos", "cycles"))
    assert view_main([str(out), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["report"] == summary["report"]
    recording = read_recording(out / "recording.npz")
    assert recording.strike == STRIKE
    assert recording.target == (1.2, 0.1)
    assert recording.joints_q is not None
    assert recording.joints_q.shape[1] == 2
    assert recording.controller is not None
    assert recording.controller["law"] == "oiac"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["strike", *WORDS, "--preset", "table4"], ["unstable at 500 Hz"]),
        (["strike", "--strike", "-1.3", "0.4", "1.7", "1.4", "0.45"], ["XM430", "N m"]),
        (["strike", *WORDS, "--port", "/dev/nowhere", "--camera", "none", "--yes"], ["/dev/nowhere"]),
        (["strike", *WORDS, "--port", "/dev/nowhere"], ["--camera: got 'twin (the default)'", "realsense"]),
    ],
)
def test_a_refused_strike_gets_one_line(words: list[str], said: list[str], tmp_path: Path, capsys) -> None:
    assert main([*words, "--out", str(tmp_path / "run")]) in (1, 2)
    error = capsys.readouterr().err.strip()
    assert "\n" not in error
    assert all(word in error for word in said), error
    assert not (tmp_path / "run").exists()  # where the corrected command goes


def test_a_resumed_search_strikes_only_what_is_left(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from whiptool.commands import rig as command

    rig = Pretend()
    monkeypatch.setattr(command, "_make_rig", lambda *_: rig)
    whole = ["learn", "--method", "random", "--max-trials", "6", "--hit-radius", "1e-6"]
    assert main([*whole, "--out", str(tmp_path / "run")]) == 0
    table = (tmp_path / "run/trials.csv").read_text().splitlines(keepends=True)
    (tmp_path / "run/trials.csv").write_text("".join(table[:4]))  # three strikes, as after a kill
    assert main(["learn", "--resume", str(tmp_path / "run")]) == 0
    assert rig.calls == 9
    header, *rows = [line.split(",") for line in (tmp_path / "run/trials.csv").read_text().splitlines()]
    assert header[-2:] == ["miss_error", "status"]
    assert [row[-2] for row in rows] == ["0.004"] * 6
    best = json.loads((tmp_path / "run/result.json").read_text())
    assert (best["miss_error"], best["hit"]) == (0.004, False)
    assert len((tmp_path / "run/trials.csv").read_text().splitlines()) == 7


class PowerCut(BaseException):
    """The run ends here."""


def test_every_strike_of_a_search_is_on_record_when_the_next_begins(tmp_path: Path, monkeypatch) -> None:
    """Also within a batch of CMA-ES; the strike that was not finished is struck again, in its own folder."""
    from whiptool.commands import rig as command

    class Fails(Pretend):
        def strike(self, strike, *, folder=None):
            if self.calls == 3:
                raise PowerCut
            return super().strike(strike, folder=folder)

    run, rig = tmp_path / "run", Fails()
    monkeypatch.setattr(command, "_make_rig", lambda *_: rig)
    words = ["learn", "--method", "cmaes", "--max-trials", "6", "--hit-radius", "1e-6", "--out", str(run)]
    with pytest.raises(PowerCut):
        main(words)
    assert len((run / "trials.csv").read_text().splitlines()) == 1 + 3
    again = Pretend()
    monkeypatch.setattr(command, "_make_rig", lambda *_: again)
    assert main(["learn", "--resume", str(run)]) == 0
    assert again.calls == 3
    assert sorted(path.name for path in run.glob("strike-*")) == [f"strike-000{i}" for i in range(1, 7)]


def test_a_search_on_the_rig_strikes_no_more_after_a_hit(tmp_path: Path, monkeypatch) -> None:
    from whiptool.commands import rig as command

    rig = Pretend()
    monkeypatch.setattr(command, "_make_rig", lambda *_: rig)
    assert main(["learn", "--method", "cmaes", "--hit-radius", "0.2", "--out", str(tmp_path / "run")]) == 0
    assert rig.calls == 3  # 0.5 / 3 < 0.2
