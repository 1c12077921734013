"""MAT files, written by SciPy, and every kind of damage."""

import numpy as np
import pytest
from recordings import FPS, STRIKE, TABLE, fuzz, places, times

from whiptool.errors import InputError
from whiptool.recording.readers import (
    read_recording,
)


def test_mat(tmp_path):
    from scipy.io import savemat

    q = np.zeros((9, 2))
    struct = {
        "t": times()[:, None], "points": 1e3 * places(), "units": "mm", "sigma": 2.0, "target": [[1.2, 0.1]],
        "markers": np.array(["tip", "handle"], object), "strike": TABLE, "joints_t": np.arange(9) / 9, "joints_q": q,
    }  # fmt: skip
    savemat(tmp_path / "a.mat", {"recording": struct, "other": 3.0}, do_compression=True)
    r = read_recording(tmp_path / "a.mat", camera="D435")
    np.testing.assert_allclose(r.points, places())
    np.testing.assert_allclose(r.sigma, 2e-3)
    assert (r.markers, r.strike, r.target, r.camera) == (("tip", "handle"), STRIKE, (1.2, 0.1), "D435")
    np.testing.assert_array_equal(r.joints_q, q)

    x, y = places()[:, :1].transpose(2, 1, 0)  # rows, as MATLAB's users write them
    savemat(tmp_path / "b.mat", {"x": x, "y": y, "fps": FPS})
    b = read_recording(tmp_path / "b.mat")
    np.testing.assert_array_equal(b.points, places()[:, :1])
    assert b.markers == ("tip",)
    np.testing.assert_allclose(b.t, times())


@pytest.mark.parametrize(
    ("variables", "said"),
    [
        ({"y": 1.0}, "points, or x and y"),
        ({"a": {"x": 1.0}, "b": {"x": 1.0}}, "exactly one struct"),
        ({"points": places()}, "the variable t"),
        ({"points": places()[:, :1], "t": times()[::-1]}, "later than"),
        ({"points": places(), "t": times()}, "2 names"),
        ({"points": places(), "t": times(), "markers": np.array([1.0, "a"], object)}, "cell array of texts"),
        ({"points": 1e3 * places()[:, :1], "t": times()}, "millimetres"),
        ({"points": places()[:, :1] + 1j, "t": times()}, "real numbers"),
        ({"points": places()[:, :1], "t": times(), "sigma": "0.00_1"}, "sigma: got .*numbers"),
    ],
)
def test_mat_damage(tmp_path, variables, said):
    from scipy.io import savemat

    savemat(tmp_path / "a.mat", variables)
    with pytest.raises(InputError, match=said):
        read_recording(tmp_path / "a.mat")


def test_mat_versions(tmp_path):
    (tmp_path / "a.mat").write_bytes(b"MATLAB 7.3 MAT-file".ljust(512) + b"\x89HDF\r\n\x1a\n" + bytes(99))
    with pytest.raises(InputError, match=r"7\.3 .HDF5.*-v7"):
        read_recording(tmp_path / "a.mat")
    (tmp_path / "a.mat").write_bytes(b"\x00" * 200)
    with pytest.raises(InputError, match="MAT version 5"):
        read_recording(tmp_path / "a.mat")


@pytest.mark.slow
@pytest.mark.parametrize("compressed", [False, True])
def test_fuzz_mat(tmp_path, compressed):
    from scipy.io import savemat

    savemat(tmp_path / "a.mat", {"t": times(), "points": places()[:, :1], "units": "m"}, do_compression=compressed)
    fuzz(tmp_path / "a.mat", 12, lambda: read_recording(tmp_path / "a.mat"))
