"""Recordings whose labels were exchanged: refused with the reason, or put back when that is asked for."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest

from whiptool.commands import identify
from whiptool.impedance import Controller
from whiptool.models import preset
from whiptool.models.kinematics import joint_points
from whiptool.models.strike import Strike
from whiptool.recording import StrikeRecording
from whiptool.rollout import CompiledRollout

STRIKE = Strike((-1.0, 0.4), (1.0, 0.6), 0.6)
MARKERS = {"handle": 2, "node6": 8, "tip": 14}  # points of the chain


@pytest.fixture
def recording() -> StrikeRecording:
    """A strike of the paper's whip, filmed at 120 frames a second with half a millimetre of noise."""
    path = CompiledRollout(preset("lemon2024"), Controller()).trajectory(STRIKE, t_stay=0.2)
    chain = joint_points(preset("lemon2024"), path.q)[:, list(MARKERS.values())]
    t = np.arange(0, path.t[-1], 1 / 120)
    points = np.stack([[np.interp(t, path.t, x) for x in marker.T] for marker in chain.transpose(1, 0, 2)])
    noise = np.random.default_rng(0).normal(0, 5e-4, (len(t), len(MARKERS), 2))
    return StrikeRecording(t, points.transpose(2, 0, 1) + noise, tuple(MARKERS), sigma=np.array(5e-4), strike=STRIKE)


@pytest.mark.slow
def test_exchanged_labels_are_refused_or_put_back(recording, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    points = recording.points.copy()
    points[45:, [0, 2]] = points[45:, [2, 0]]
    recording.save("whole.npz")
    dataclasses.replace(recording, points=points).save("swapped.npz")
    words = ["--drive", "handle", "--free", "k", "b", "--starts", "1", "--json", "--out"]
    assert identify.main(["swapped.npz", *words, "refused"]) == 2
    told = capsys.readouterr()
    assert told.err.count("\n") == 1
    assert "swapped.npz: handle became tip, tip became handle at 0.375 s" in told.err
    assert "--mend-labels" in told.err
    assert not (tmp_path / "refused").exists()
    found = {}
    for name, more in (("whole", []), ("swapped", ["--mend-labels"])):
        assert identify.main([f"{name}.npz", *words, name, *more]) == 0
        said = capsys.readouterr()
        found[name] = {p["name"]: p["value"] for p in json.loads(said.out)["parameters"]}
        assert ("put back" in said.err) == (name == "swapped")
    assert found["swapped"] == found["whole"]
