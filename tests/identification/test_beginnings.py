"""Slips that are found before a fit: units, axes, turned frames, joints, and when a strike began."""

from __future__ import annotations

import dataclasses
from functools import cache

import numpy as np
import pytest
from films import film

from whiptool.errors import InputError
from whiptool.identification.beginnings import check_beginnings
from whiptool.identification.fit import fit
from whiptool.identification.plant import Plant
from whiptool.identification.predict import Predictor
from whiptool.impedance import Controller
from whiptool.models import preset
from whiptool.models.strike import default_bounds
from whiptool.recording.strike_recording import StrikeRecording

LEMON, CONTROLLER = preset("lemon2024"), Controller()
STRIKE = default_bounds(LEMON.arm).sample(np.random.default_rng(0), 2)[1]
OTHER = LEMON.with_parameters({"whip.k": 0.35, "whip.b": 0.06, "whip.m": 0.016, "whip.l": 0.85 * LEMON.whip.l})
TURN = np.array([[np.cos(0.5), -np.sin(0.5)], [np.sin(0.5), np.cos(0.5)]])


@cache
def sound() -> StrikeRecording:
    return dataclasses.replace(film(LEMON, STRIKE, np.random.default_rng(1)), source="strike.csv")


def placed(mend) -> StrikeRecording:
    return dataclasses.replace(sound(), points=mend(sound().points))


def moved(mend) -> StrikeRecording:
    return dataclasses.replace(sound(), joints_q=mend(sound().joints_q))


def late(by: float) -> StrikeRecording:
    return dataclasses.replace(sound(), t=sound().t + by, t_points=sound().t_points + by)


def checked(recording: StrikeRecording, model=OTHER, drive: str = "joints") -> list[str]:
    """What is said of a recording where a fit starts from another whip, 15 % shorter."""
    plant = Plant(model, CONTROLLER)
    return check_beginnings(Predictor([recording], plant, drive=drive, shared=()), plant)


@pytest.mark.parametrize("drive", ["command", "joints"])
def test_a_sound_recording_of_a_whip_that_is_not_quite_the_models_passes(drive):
    assert checked(sound(), drive=drive) == []


@pytest.mark.parametrize("drive", ["command", "joints"])
@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (lambda: placed(lambda x: x / 1000), "they were m, read as mm"),
        (lambda: placed(lambda x: x / 100), "they were m, read as cm"),
        (lambda: placed(lambda x: x * 10), "they were mm, read as cm"),
        (lambda: placed(lambda x: x / 10), "they were cm, read as mm"),
        (lambda: placed(lambda x: x / 25.4), "they were in, read as mm"),
        (lambda: placed(lambda x: x / 2.54), "they were in, read as cm"),
        (
            lambda: placed(lambda x: x - [-0.2, -1.4]),
            r"shifted by \(0\.[12]\d, 1\.\d\d\) m: say origin, in the .* unit",
        ),
        (lambda: placed(lambda x: x[..., ::-1] * [-1, 1]), r"axes should be \(y, -x\)"),
        (lambda: placed(lambda x: x * [1, -1]), r"axes should be \(x, -y\)"),
        (
            lambda: placed(lambda x: x @ TURN.T),
            "turned by (2[5-9]|3[0-2]) degrees",
        ),
    ],
)
def test_a_slip_is_named(wrong, said, drive):
    with pytest.raises(InputError, match=f"^strike.csv: .*as if .*{said}"):
        checked(wrong(), drive=drive)


def test_a_strike_that_began_later_is_told():
    with pytest.raises(
        InputError, match=r"^strike.csv: t: .*its strike began 0\.[789]\d s after its time 0: say start"
    ):
        checked(late(0.8), drive="command")


def test_a_slip_stops_a_fit_before_it_begins():
    with pytest.raises(InputError, match="read as mm"):
        fit(placed(lambda x: x / 1000), Plant(OTHER, CONTROLLER), ["k"])


def test_where_a_recording_lies_is_not_judged_where_it_is_sought():
    plant = Plant(OTHER, CONTROLLER)
    turned = placed(lambda x: x @ TURN.T)
    assert check_beginnings(Predictor([turned], plant, drive="joints", shared=["rotation"]), plant) == []


def test_a_base_that_stands_elsewhere_is_remarked():
    """A shift along the vertical could be a whip of another length: it is told, and the fit goes on."""
    (said,) = checked(placed(lambda x: x - [0.0, 0.6]), LEMON)
    assert said.startswith("strike.csv: its first readings are 0.60 m from where the model's whip hangs")
    assert "as if all of it were shifted by (0.00, -0.60) m: say origin" in said


@pytest.mark.parametrize("drive", ["command", "joints"])
@pytest.mark.parametrize(
    ("mend", "said"),
    [
        (lambda q: q[:, ::-1], "columns 1 and 2 are exchanged"),
        (lambda q: q - [0, 2 * np.pi], "off by whole turns"),
        (lambda q: -q, "other sign"),
        (lambda q: q - [0.5, 0.0], "another (strike|time)"),
        (
            lambda q: np.where(np.arange(len(q))[:, None] > 300, q + 2 * np.pi, q),
            "jumps by \\+6.2. rad at 0.301 s.*unwrap",
        ),
    ],
)
def test_a_log_that_cannot_be_the_strikes_is_refused(mend, said, drive):
    with pytest.raises(InputError, match=f"^strike.csv: joints: .*{said}"):
        checked(moved(mend), drive=drive)


def test_degrees_are_told_from_where_the_strike_begins():
    q, strike = 0.05 * sound().joints_q, sound().strike
    strike = dataclasses.replace(strike, q_i=tuple(q[0]), q_f=tuple(q[-1]))
    with pytest.raises(InputError, match="they are degrees, read as radians"):
        checked(dataclasses.replace(sound(), joints_q=np.degrees(q), strike=strike))
