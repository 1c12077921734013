"""A real pendulum, released by hand: fitted on some swings, predicting others (data beside the repository)."""

from __future__ import annotations

import numpy as np
import pytest
from pendulum_data import DATA
from pendulum_swing import angles_of, pendulum

from whiptool.identification.fit import FitOptions, fit
from whiptool.models.parameters import ArmLink
from whiptool.recording.strike_recording import StrikeRecording

pytestmark = pytest.mark.skipif(
    not DATA.is_dir(), reason=f"no recorded pendulum in {DATA}; set WHIPTOOL_DATA to the folder that holds it"
)


def swings(name: str, *, every: int, last: int | None = None) -> list[StrikeRecording]:
    """All pieces of a file, every so many samples, up to sample `last`."""
    data = np.load(DATA / f"{name}.npz")
    t = np.arange(data["angle"].shape[1]) * float(data["dt"])
    return [
        angles_of(t[:last:every], (q - np.pi)[:last:every], np.array([q[0] - np.pi, v[0]]), 2e-3, f"{name} {i}")
        for i, (q, v) in enumerate(zip(data["angle"], data["velocity"], strict=True))
    ]


@pytest.mark.slow
def test_double_pendulum_predicts_the_held_out_pieces():
    held = (4, 11, 18, 25)
    train = [r for i, r in enumerate(swings("double", every=12)) if i not in held]
    unseen = [swings("double", every=1, last=1501)[i] for i in held]
    # two uniform rods of 0.2 m, as one would guess from afar
    guess = pendulum((ArmLink(mass=0.2, length=0.2), ArmLink(mass=0.1, length=0.2)), (1e-3, 1e-3))
    free = [f"link.{q}[{i}]" for q in ("mass", "com", "inertia", "friction", "dry_friction", "drag") for i in range(2)]
    options = FitOptions(drive="free", pieces=(0.3,), starts=3, dispersion=3.0)
    result = fit(train, guess, [*free, "link.length[0]"], held_out=unseen, options=options)

    rmse = [1e3 * r.rmse for r in result.held_out]
    print("held-out angle RMSE [mrad]", np.round(rmse, 2), "median", np.median(rmse))
    assert np.median(rmse) <= 3.5
    costs = [run.solution.cost for run in result.runs]
    assert max(costs) < 1.01 * min(costs), "all three starts end alike"
    # free swing sees ratios: neither the scale of masses and losses, nor (twice) how a link's mass is spread
    assert result["link.length[0]"].kind == "well determined"
    assert result.uncertainty.flat.sum() == 3
    for name in (f"link.{q}[{i}]" for q in ("mass", "dry_friction", "drag") for i in range(2)):
        assert result[name].kind == "flat"
        assert result[name].interval is None
    assert result.uncertainty.product({"link.mass[1]": 1})[1] is None


@pytest.mark.slow
def test_single_pendulum_with_and_without_dry_friction():
    """Each piece held out in turn and predicted for 9 s: dry friction explains how small swings end."""
    pieces = swings("single", every=25)
    guess = pendulum((ArmLink(mass=0.2, length=0.3),))
    options = FitOptions(drive="free", pieces=(1.0, 3.0))
    found = {}
    for dry in (True, False):
        free = ["link.inertia[0]", "link.friction[0]", "link.drag[0]", *(["link.dry_friction[0]"] if dry else [])]
        found[dry] = []
        for i, unseen in enumerate(pieces):
            train = [r for j, r in enumerate(pieces) if j != i]
            found[dry].append(1e3 * fit(train, guess, free, held_out=[unseen], options=options).held_out[0].rmse)
    print("held-out RMSE [mrad] with dry friction", np.round(found[True], 1), "without", np.round(found[False], 1))
    assert np.median(found[True]) < 0.7 * np.median(found[False])
