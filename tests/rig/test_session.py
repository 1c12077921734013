"""A strike from the command line to its recording; a search on the rig; filming beside the loop."""

from __future__ import annotations

import json
import threading
from pathlib import Path

import numpy as np
import pytest
from processes import HANG

import whiptool as wt
from whiptool.errors import InputError
from whiptool.impedance import OIAC, Controller
from whiptool.objective import Objective, Target
from whiptool.optimizers import search
from whiptool.recording.readers import read_recording
from whiptool.rig.filming import Filming
from whiptool.rig.loop import LoopOptions

pytest.importorskip("dynamixel_sdk")
pytest.importorskip("cv2")

from whiptool.commands.rig import main
from whiptool.commands.view import main as view_main
from whiptool.impedance.files import controller_to_table
from whiptool.rig.rehearsal import rehearse
from whiptool.rig.session import RigRollout, TwinRig, TwinTruth
from whiptool.vision.camera_model import camera_preset
from whiptool.vision.source import Frame

pytestmark = pytest.mark.slow

STRIKE = wt.Strike.from_vector([-0.622, 0.221, 0.705, 2.122, 1.176])  # within the XM430's line, hits (1.2, 0.1)
WORDS = ["--strike", *map(str, STRIKE.vector), "--target", "1.2", "0.1"]
MODEL, CONTROLLER = wt.preset("lemon2024"), Controller(OIAC())


def test_a_strike_leaves_a_recording_that_identification_reads(tmp_path: Path, capsys) -> None:
    out = tmp_path / "run"
    assert main(["strike", *WORDS, "--camera", "points", "--settle", "0.2", "--json", "--out", str(out)]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["fault"] is None
    assert summary["torque_off"]
    assert summary["missed"] == 0
    assert 0 < summary["miss_error"] < 0.01
    assert abs(summary["miss_distance"] - summary["true_miss_distance"]) < 4 * summary["miss_error"]
    assert summary["hit"] == (summary["hit_probability"] >= 0.9)
    report = Path(summary["report"]).read_text(encoding="utf-8")
    assert f"{summary['hit_probability']:.0%} probable" in report
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


def test_an_ideal_twin_is_seen_to_do_what_the_model_says() -> None:
    rig = TwinRig(MODEL, CONTROLLER, camera="points", at_once=True, target=(1.2, 0.1))
    struck = rig.strike(STRIKE)
    held = Controller(OIAC(), control_period=0.002)
    model = wt.CompiledRollout(MODEL, held).approach(STRIKE.vector[None], (1.2, 0.1), t_stay=0.3)
    seen = struck.approach(np.array([1.2, 0.1]))
    assert struck.truth is not None
    assert seen.distance == pytest.approx(model.distance, abs=0.01)  # encoders count in steps of 1.5 mrad
    assert seen.tip[0] == pytest.approx(model.tip[0], abs=0.01)


def test_a_rig_compensates_the_weights_that_its_owner_knows_of() -> None:
    """A heavier whip: rig, rehearsal and compiled model agree once the model's controller reckons as the rig's does."""
    heavy = MODEL.with_parameters({"whip.m": 0.016})
    struck = TwinRig(MODEL, CONTROLLER, truth=TwinTruth(heavy), camera="points", at_once=True).strike(
        STRIKE, believed=heavy
    )
    assert struck.truth is not None
    assert struck.recording is not None
    held = Controller(OIAC(), control_period=0.002)
    assert struck.recording.controller == controller_to_table(CONTROLLER.reckoning_with(MODEL))
    own, rigs = (
        wt.CompiledRollout(heavy, c).approach(STRIKE.vector[None], (1.2, 0.1), t_stay=0.3)
        for c in (held, held.reckoning_with(MODEL))
    )
    true = struck.truth.approach(np.array([1.2, 0.1]))
    assert true.tip[0] == pytest.approx(rigs.tip[0], abs=0.01)
    assert np.hypot(*(true.tip[0] - own.tip[0])) > 0.03
    played = rehearse(MODEL, CONTROLLER, STRIKE, delay=0.0, believed=heavy).trajectory
    q = np.array([np.interp(played.t, struck.truth.t, x) for x in struck.truth.q[:, :2].T])
    np.testing.assert_allclose(played.q[:, :2].T, q, atol=0.005)
    with pytest.raises(InputError, match="XM430-W350 gives"):
        TwinRig(MODEL, CONTROLLER, camera="none", at_once=True).strike(
            STRIKE, believed=MODEL.with_parameters({"whip.m": 0.03})
        )


def test_the_camera_clock_and_the_true_whip_are_the_twins_own() -> None:
    heavy = MODEL.with_parameters({"whip.m": 0.02})
    truth = TwinTruth(heavy, clock_offset=0.004)
    plain = TwinRig(MODEL, CONTROLLER, camera="points", at_once=True).strike(STRIKE)
    other = TwinRig(MODEL, CONTROLLER, truth=truth, camera="points", at_once=True).strike(STRIKE)
    assert plain.recording is not None
    assert other.recording is not None
    assert other.recording.t[0] == pytest.approx(0.004)
    last = min(len(plain.recording.t), len(other.recording.t)) - 1
    assert np.hypot(*(plain.recording.points[last, 0] - other.recording.points[last, 0])) > 0.01


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["strike", *WORDS, "--preset", "table4"], ["unstable at 500 Hz"]),
        (["strike", "--strike", "-1.3", "0.4", "1.7", "1.4", "0.45"], ["XM430", "N m"]),
        (["strike", *WORDS, "--port", "/dev/nowhere", "--camera", "none", "--yes"], ["/dev/nowhere"]),
    ],
)
def test_a_refused_strike_gets_one_line(words: list[str], said: list[str], tmp_path: Path, capsys) -> None:
    assert main([*words, "--out", str(tmp_path / "run")]) in (1, 2)
    error = capsys.readouterr().err.strip()
    assert "\n" not in error
    assert all(word in error for word in said), error
    assert not (tmp_path / "run").exists()  # where the corrected command goes


class Pretend:
    """A rig whose tip is seen on a straight line past a point that the strike decides."""

    def __init__(self, refuse: bool = False) -> None:
        self.calls, self.refuse = 0, refuse

    def strike(self, strike, *, folder=None):
        self.calls += 1
        if self.refuse:
            raise InputError("strike", "x", "y")
        return self

    def judged(self, target):
        from whiptool.identification.judgement import Judgement, Nearest

        return Judgement(0.5 / self.calls, 0.004, 1.0, Nearest(0.7, (1.0, 0.5), (3.0, 4.0)))

    def approach(self, target):
        from whiptool.rollout.trajectory import Approach

        two = np.zeros((1, 2))
        return Approach(np.array([0.5 / self.calls]), np.zeros(1), two, two, two, two, np.zeros(1, bool))


def test_a_search_has_the_rig_as_its_objective(tmp_path: Path) -> None:
    rig = Pretend()
    rollout = RigRollout(lambda number: rig, MODEL, folder=tmp_path)
    result = search(Objective(rollout, Target(), max_trials=20, stop_at_hit=True), "random", seed=1)
    assert result.first_hit == 10  # 0.5 / 9 < 0.06, but not for certain enough: the camera's error is 4 mm
    assert result.outcome is not None
    assert result.outcome.miss_error == 0.004
    assert result.outcome.hit_time == 0.7
    assert result.outcome.tip_speed == 5.0
    assert len(list(tmp_path.glob("strike-*"))) == rig.calls
    refused = RigRollout(lambda number: Pretend(refuse=True), MODEL)
    lost = search(Objective(refused, Target(), max_trials=3), "random", seed=1)
    assert lost.n_diverged == 3


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
    assert header[-1] == "miss_error"
    assert [row[-1] for row in rows] == ["0.004"] * 6
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


class Ticking:
    """A camera, 200 frames a second by a clock of its own; what it films comes 3 to 5 ms later. It is the time, too."""

    def __init__(self, begin: int, end: int) -> None:
        self.settings, self.n, self.closed = camera_preset("d435-infrared"), 0, False
        self.begin, self.end, self.over = begin, end, threading.Event()

    def open(self) -> None:
        self.told = threading.Event()

    def monotonic(self) -> float:
        """The loop's clock, as the last frame comes."""
        return 50.0 + 0.005 * self.n + 0.003 + 0.001 * (self.n % 3)

    def read(self, timeout: float) -> Frame | None:
        self.told.wait()
        self.n += 1
        if self.n == self.begin:
            self.filming.during(True)
        if self.n == self.end:
            self.filming.during(False)
            self.over.set()
        t = 1000.0 + 0.005 * self.n
        return Frame(np.zeros((480, 848), np.uint8), t=t, clock="camera", sequence=self.n, settings=self.settings)

    def close(self) -> None:
        self.closed = True


def test_filming_keeps_the_strike_on_the_loops_clock(monkeypatch: pytest.MonkeyPatch) -> None:
    camera = Ticking(begin=60, end=100)
    monkeypatch.setattr("whiptool.rig.filming.time", camera)
    filming = Filming(camera, keep_before=0.05)
    filming.during(False)
    camera.filming = filming
    camera.told.set()
    assert camera.over.wait(HANG)
    frames = filming.end()
    assert camera.closed
    assert frames[-1].sequence == 100  # the frame under way, and none after it
    assert frames[0].sequence in (49, 50)  # 50 ms before
    numbers = np.array([frame.sequence for frame in frames])
    assert (np.diff(numbers) == 1).all()
    # by the loop's clock, late by the shortest delay
    np.testing.assert_allclose([frame.t for frame in frames], 50.003 + 0.005 * numbers, atol=1e-9)


def test_loop_options_of_the_twin() -> None:
    rig = TwinRig(MODEL, CONTROLLER, camera="none", at_once=True, options=LoopOptions(rate=1000.0))
    assert rig.options.settle == 0
    assert rig.strike(STRIKE).run.fault is None
