"""An adaptation whose strike is stopped: nothing is learned from it, and nothing is struck before a person says so."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import whiptool as wt
from whiptool.adaptation import adapter
from whiptool.adaptation.adapter import OUTCOME, Adapter, NoPlan, Options
from whiptool.adaptation.plan_search import Plan
from whiptool.adaptation.ports import RigPort
from whiptool.adaptation.prior import default_prior
from whiptool.adaptation.steps import Seen
from whiptool.goals.target import Target
from whiptool.impedance import OIAC, Controller
from whiptool.recording.strike_recording import StrikeRecording
from whiptool.rig.stops import STOPPED, Locked, StrikeInterrupted, StrikeRefused, StrikeStopped

MODEL, CONTROLLER = wt.preset("lemon2024"), Controller(OIAC())
STRIKE = wt.Strike.from_vector([-0.622, 0.221, 0.705, 2.122, 1.176])
PLAN = Plan(tuple(map(float, STRIKE.vector)), None, None, None, None, "as given", 0.0)
TARGET = Target((1.2, 0.1))


class Robot:
    """A port whose second strike ends as it is told."""

    def __init__(self, end: BaseException | Seen) -> None:
        self.end, self.numbers = end, []

    def strike(self, strike, number, folder, believed=None):
        self.numbers.append(number)
        if number == 2:
            if isinstance(self.end, BaseException):
                raise self.end
            return self.end
        return Seen(None, 0.5)


def adaptation(port, folder: Path | None = None) -> wt.Adaptation:
    options = Options(max_strikes=4, stop_at=0.0, still=False, adapt=False)
    return wt.Adaptation(default_prior(MODEL, CONTROLLER), port, TARGET, options, folder, opening=PLAN)


@pytest.mark.parametrize(
    "end",
    [StrikeStopped("hardware: servo 1 is hot", None, "torque is off"), Seen(None, None, fault="hot")],
)
def test_a_fault_ends_the_run_and_locks_it(end, tmp_path: Path) -> None:
    port = Robot(end)
    run, steps = adaptation(port, tmp_path), []
    with pytest.raises(StrikeStopped, match="hot"):
        run.run(steps.append)
    assert [step.number for step in steps] == [1]
    assert "hot" in json.loads((tmp_path / STOPPED).read_text())["reason"]
    assert not (tmp_path / "strike-0002" / OUTCOME).exists()
    for again in (run, adaptation(port, tmp_path)):  # in this process, and in another
        with pytest.raises(Locked):
            again.run()
    assert port.numbers == [1, 2]
    port.end = Seen(None, 0.4)
    run.interlock.release()
    assert [step.number for step in run.run()] == [1, 2, 3, 4]
    assert port.numbers == [1, 2, 2, 3, 4]  # what was not carried out is no trial


def test_a_signal_ends_the_run_and_no_one_is_asked(tmp_path: Path) -> None:
    port = Robot(StrikeInterrupted("signal: SIGINT came", None, "torque is off"))
    with pytest.raises(KeyboardInterrupt):
        adaptation(port, tmp_path).run()
    assert not (tmp_path / STOPPED).exists()
    port.end = Seen(None, 0.4)
    assert len(adaptation(port, tmp_path).run()) == 4


def test_a_refused_strike_is_told_and_the_next_one_is_made() -> None:
    class Refuses:
        def strike(self, strike, *, folder=None, believed=None):
            raise StrikeRefused("strike", [0.0], "what the motors can carry", "lengthen D")

    steps = adaptation(RigPort(lambda number: Refuses(), TARGET.position)).run()
    assert len(steps) == 4
    assert all("lengthen D" in step.outcome.refused and step.judged is None for step in steps)


def test_a_strike_that_must_not_be_made_is_not_handed_over(tmp_path: Path, monkeypatch) -> None:
    """The run ends in one line, and nothing counts."""
    planned = [replace(PLAN, probability=0.9, reason="below the floor", allowed=False)] * 3
    monkeypatch.setattr("whiptool.adaptation.planner._searched", lambda *_: planned.pop())
    port, options = Robot(Seen(None, None)), Options(still=False, adapt=False, retries=2)
    run = wt.Adaptation(default_prior(MODEL, CONTROLLER), port, TARGET, options, tmp_path)
    with pytest.raises(NoPlan, match="no plan for strike 1, which is not made: below the floor"):
        run.run()
    assert (port.numbers, planned) == ([], [])  # each search was made
    assert not (tmp_path / "strike-0001").exists()


def test_a_long_plan_shows_how_many_strikes_were_judged(monkeypatch, capsys) -> None:
    def plan(*args, demands, **named):
        assert [demands.check(STRIKE) for _ in range(3)] == ["below the floor"] * 3
        return PLAN

    monkeypatch.setattr(adapter, "_SOON", 0.0)
    monkeypatch.setattr(adapter, "plan", plan)
    options = Options(still=False, adapt=False, check=lambda strike, believed: "below the floor")
    assert Adapter(default_prior(MODEL, CONTROLLER), TARGET, options).ask() == STRIKE
    assert "planning strike 1: 3 strikes judged" in capsys.readouterr().err


def test_what_a_port_would_refuse_is_not_planned() -> None:
    class Careful(Robot):
        def refusal(self, strike, believed=None):
            return None if strike.D > 1 else "too fast"

    def own(strike, believed) -> None:
        return None

    careful, prior = Careful(Seen(None, None)), default_prior(MODEL, CONTROLLER)
    check = wt.Adaptation(prior, careful, TARGET).adapter().options.demands(MODEL).check
    assert check is not None
    assert (check(STRIKE), check(replace(STRIKE, D=0.9))) == (None, "too fast")
    assert wt.Adaptation(prior, careful, TARGET, Options(check=own)).adapter().options.check is own
    assert wt.Adaptation(prior, Robot(Seen(None, None)), TARGET).adapter().options.check is None


def test_bad_set_up_of_a_rig_is_no_refused_strike() -> None:
    class Unfit:
        def strike(self, strike, *, folder=None, believed=None):
            raise wt.errors.InputError("servo 1: homing_offset", 1024, "0")

    with pytest.raises(ValueError, match="homing_offset"):
        adaptation(RigPort(lambda number: Unfit(), TARGET.position)).run()


def test_nothing_is_learned_from_a_strike_that_was_broken_off() -> None:
    t = np.arange(30) / 60
    film = StrikeRecording(t, np.tile([1.0, 0.0], (30, 1, 1)), ("tip",), np.array(0.005), strike=STRIKE)
    prior = default_prior(MODEL, CONTROLLER)
    one = Adapter(prior, TARGET, Options(still=False), opening=PLAN)
    one.ask()
    step = one.tell(Seen(film, 0.01, fault="a cable came loose"))
    assert step.learned is None
    assert step.judged is None
    assert one.belief is prior
    assert not one.done
