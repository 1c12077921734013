"""The benchmark of real recordings on small made-up folders: a user's `real.toml`, its refusals, and the plain fit."""

from __future__ import annotations

import json
import sys
from dataclasses import replace

import numpy as np
import pytest
import tomli_w
from pendulum_swing import pendulum, swing
from repository import ROOT

from whiptool.errors import InputError
from whiptool.identification.plant import write_bare_arm
from whiptool.models.parameters import ArmLink

sys.path.insert(0, str(ROOT / "benchmarks"))
import real
from peers.plain_pendulum import PlainFit, plain_study, simulated


@pytest.fixture(scope="module")
def swings():
    """Four swings of a link whose centre of mass is at 0.2 m, with 1 mrad of noise."""
    plant, rng = pendulum((ArmLink(0.2, 0.3, 0.2, 1e-3),)), np.random.default_rng(0)
    return [swing(plant, np.array([[x], [0.0]]), rng) for x in (0.5, -0.8, 0.6, -0.4)]


def written(folder, swings, **changes):
    """A folder as a user would write it."""
    np.savez(folder / "swings.npz", t=swings[0].t, angle=np.stack([r.points[..., 0] for r in swings]))
    write_bare_arm(pendulum((ArmLink(0.2, 0.3, 0.15, 1e-3),)).model, folder / "guess.toml")
    table = {"recordings": ["swings.npz"], "model": "guess.toml", "drive": "free", "free": ["com", "zero"]}
    table |= {"held_out": [3], "horizons": [0.5, 1.0]} | changes
    (folder / "real.toml").write_text(tomli_w.dumps({k: v for k, v in table.items() if v is not None}))
    return folder


def test_a_users_folder_gives_errors_and_coverage(tmp_path, swings, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["real.py", str(written(tmp_path, swings)), "--json"])
    real.main()
    (found,) = json.loads(capsys.readouterr().out).values()
    assert (found["recordings"], found["held_out"]) == (4, 1)
    assert set(found["predicted"]) == {"0.5 s", "1 s", "all"}
    assert found["predicted"]["all"]["rms"] < 1.5e-3  # 1 mrad is the readings' noise
    assert 0.75 < found["predicted"]["all"]["coverage_90"] <= 1
    assert found["classes"]["link.com[0]"] == "well determined"


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"held_out": [9]}, "held_out"),
        ({"held_out": [0, 1, 2, 3]}, "so that others are fitted"),
        ({"held_out": []}, "so that others are fitted"),
        ({"each": 0}, "each: got 0; allowed: a whole number from 2 to 4"),
        ({"free": "com"}, "free: got 'com'; allowed: a list"),
        ({"horizons": ["soon"]}, "horizons"),
        ({"colour": "red"}, "colour"),
        ({"model": None}, "model"),
    ],
)
def test_a_bad_description_is_named(tmp_path, swings, changes, said):
    with pytest.raises(InputError, match=said):
        real.user_recordings(written(tmp_path, swings, **changes))


def test_a_folder_without_anything_known_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"real\.toml"):
        real.studies(tmp_path, quick=True)


def test_the_plain_fit_finds_what_it_simulates(swings):
    """One link: weight m g c over I + m c^2; held out it errs by the noise. Two links: the energy stays."""
    p, _ = PlainFit(swings[:3]).fit()
    assert p[0] == pytest.approx(0.2 * 9.81 * 0.2 / (1e-3 + 0.2 * 0.2**2), rel=2e-3)
    ((after, error, half, most),) = plain_study(swings, [[3]])
    assert np.sqrt(np.mean(error**2)) < 1.5e-3
    assert 0.8 < np.mean(np.abs(error) < most) < 0.98
    assert (half < most).all()
    assert after.min() == pytest.approx(0.005)
    alpha, beta, first, second = 4.0, 1.5, 220.0, 73.6
    numbers, start = np.array([[alpha, beta, first, second, 0.0, 0.0]]), np.array([[1.0, -0.5, 0.0, 0.0]])
    (q,) = simulated(2, numbers, start, 1000, 1e-3)
    v = np.gradient(q, 1e-3, axis=0)[5:-5]
    q = q[5:-5]
    kinetic = (alpha * v[:, 0] ** 2 + v[:, 1] ** 2) / 2 + beta * np.cos(q[:, 0] - q[:, 1]) * v[:, 0] * v[:, 1]
    energy = kinetic - first * np.cos(q[:, 0]) - second * np.cos(q[:, 1])
    assert np.ptp(energy) < 1e-3 * np.ptp(kinetic)


def test_what_was_fitted_is_kept_and_made_anew_of_other_recordings(tmp_path, swings, monkeypatch):
    """The same command in the same folder fits nothing again; with another guess it does."""
    given = real.user_recordings(written(tmp_path, swings))
    first = real.study(given, tmp_path / "kept")
    monkeypatch.setattr(real, "fit", lambda *_, **__: pytest.fail("it was fitted again"))
    assert json.dumps(real.study(given, tmp_path / "kept")) == json.dumps(first)
    other = replace(given, plant=given.plant.changed({"link.com[0]": 0.16}))
    with pytest.raises(pytest.fail.Exception, match="fitted again"):
        real.study(other, tmp_path / "kept")
