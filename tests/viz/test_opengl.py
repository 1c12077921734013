"""Where OpenGL draws, and what is added to a scene: geometry by hand, without drawing it."""

from __future__ import annotations

import importlib
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

from whiptool.viz import opengl
from whiptool.viz.opengl import add_bar, add_rod, gl_context


@pytest.fixture
def asked(monkeypatch) -> list[str]:
    """Modules whose context is asked for."""
    names: list[str] = []

    def load(name: str) -> SimpleNamespace:
        names.append(name)
        return SimpleNamespace(GLContext=lambda width, height: (width, height))

    monkeypatch.setattr(importlib, "import_module", load)
    monkeypatch.setattr(opengl.sys, "platform", "linux")
    for variable in ("MUJOCO_GL", "DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(variable, raising=False)
    return names


@pytest.mark.parametrize(
    ("environment", "module"),
    [
        ({}, "mujoco.egl"),
        ({"MUJOCO_GL": " EGL "}, "mujoco.egl"),
        ({"MUJOCO_GL": "osmesa"}, "mujoco.osmesa"),
        ({"MUJOCO_GL": "osmesa", "DISPLAY": ":0"}, "mujoco.osmesa"),
        ({"DISPLAY": ":0"}, "mujoco.gl_context"),
        ({"WAYLAND_DISPLAY": "wayland-0"}, "mujoco.gl_context"),
    ],
)
def test_the_variable_decides_else_the_display(asked, monkeypatch, environment: dict[str, str], module: str):
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    assert gl_context(64, 48) == (64, 48)
    assert asked == [module]


@pytest.mark.parametrize("word", ["disabled", "off", "0", "False"])
def test_opengl_can_be_switched_off(asked, monkeypatch, word: str):
    monkeypatch.setenv("MUJOCO_GL", word)
    with pytest.raises(RuntimeError, match=f"MUJOCO_GL={word.lower()}"):
        gl_context(64, 48)
    assert asked == []


@pytest.fixture
def scene() -> mujoco.MjvScene:
    model = mujoco.MjModel.from_xml_string("<mujoco><worldbody/></mujoco>")
    return mujoco.MjvScene(model, maxgeom=4)


@pytest.mark.parametrize("ends", [[[0.0, 0.0], [3.0, 4.0]], [[1.0, 2.0], [-0.5, 2.0]], [[0.2, 0.3], [0.2, 0.3]]])
def test_a_bar_lies_along_its_ends_behind_the_plane(scene, ends):
    """Flat across the plane, half a thickness longer at either end; the plane's y is up."""
    ends = np.array(ends)
    add_bar(scene, ends, 0.07, 0.02, (0.1, 0.2, 0.3))
    assert scene.ngeom == 1
    geom, length = scene.geoms[0], np.linalg.norm(ends[1] - ends[0])
    assert geom.size == pytest.approx([(length + 0.02) / 2, 1e-4, 0.01], rel=1e-6)
    assert geom.pos == pytest.approx([*ends.mean(axis=0)[:1], 0.07, ends.mean(axis=0)[1]], abs=1e-6)
    along = geom.mat[:, 0]
    assert length * along == pytest.approx([ends[1, 0] - ends[0, 0], 0, ends[1, 1] - ends[0, 1]], abs=1e-6)
    np.testing.assert_allclose(geom.mat @ geom.mat.T, np.eye(3), atol=1e-6)
    assert np.linalg.det(geom.mat) == pytest.approx(1, abs=1e-6)
    assert geom.rgba == pytest.approx([0.1, 0.2, 0.3, 1])


def test_a_rod_reaches_from_end_to_end(scene):
    ends = np.array([[0.1, 0.2, 0.3], [0.4, -0.2, 0.3]])
    add_rod(scene, ends, 0.01, (1.0, 0.0, 0.0))
    add_rod(scene, ends[::-1], 0.02, (0.0, 1.0, 0.0))
    assert scene.ngeom == 2
    geom = scene.geoms[0]
    assert geom.pos == pytest.approx(ends.mean(axis=0), abs=1e-6)
    assert geom.size[0] == pytest.approx(0.01)
    assert abs(geom.mat[:, 2] @ (ends[1] - ends[0])) == pytest.approx(0.5, abs=1e-6)
    assert 2 * geom.size[2] == pytest.approx(0.5, abs=1e-6)
    assert scene.geoms[1].rgba == pytest.approx([0, 1, 0, 1])
