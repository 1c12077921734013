"""Recordings in NPZ: they come back, and damage to them is named."""

import pickle

import numpy as np
import pytest
from recordings import full, fuzz, places, same, times

from whiptool.errors import InputError
from whiptool.recording.readers import (
    read_recording,
)
from whiptool.recording.strike_recording import StrikeRecording


def test_npz_round_trip(tmp_path):
    full().save(tmp_path / "a.npz")
    same(StrikeRecording.load(tmp_path / "a.npz"), full())
    same(read_recording(tmp_path / "a.npz"), full())
    np.savez(tmp_path / "b.npz", t=times(), points=places(), markers=["tip", "handle"])  # by hand
    b = read_recording(tmp_path / "b.npz")
    assert b.source == str(tmp_path / "b.npz")
    assert len(b.sha256) == 64


def test_npz_never_unpickles(tmp_path):
    class Bomb:
        def __reduce__(self):
            return (open, (str(tmp_path / "exploded"), "w"))

    np.savez(tmp_path / "a.npz", t=times(), points=places(), markers=np.array([Bomb(), Bomb()], object))
    with pytest.raises(InputError, match="allow_pickle"):
        read_recording(tmp_path / "a.npz")
    (tmp_path / "b.npz").write_bytes(pickle.dumps(Bomb()))
    with pytest.raises(InputError):
        read_recording(tmp_path / "b.npz")
    assert not (tmp_path / "exploded").exists()


@pytest.mark.parametrize(
    ("arrays", "said"),
    [
        ({"t": times(), "points": places()}, "markers"),
        ({"t": times(), "points": places(), "markers": ["a", "b"], "colour": 1}, "colour"),
        ({"t": times(), "points": places(), "markers": ["a", "b"], "format": 2}, "another version"),
        ({"t": times(), "points": places(), "markers": ["a", "b"], "strike": [1.0, 2.0]}, "strike"),
        ({"t": times(), "points": places(), "markers": ["a", "b"], "controller": "{"}, "JSON"),
    ],
)
def test_npz_damage(tmp_path, arrays, said):
    np.savez(tmp_path / "a.npz", **arrays)
    with pytest.raises(InputError, match=said):
        read_recording(tmp_path / "a.npz")


def test_fuzz_npz(tmp_path):
    full().save(tmp_path / "a.npz")
    fuzz(tmp_path / "a.npz", 150, lambda: read_recording(tmp_path / "a.npz"))
    np.savez(tmp_path / "b.npz", t=times(), points=places(), markers=["tip", "handle"])  # not compressed
    fuzz(tmp_path / "b.npz", 150, lambda: read_recording(tmp_path / "b.npz"))
