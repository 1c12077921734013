"""What robots look like: meshes and simple shapes of their files, in the frames of the links that carry them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from robot_files import MJCF, URDF
from scipy.spatial.transform import Rotation

from whiptool.errors import InputError
from whiptool.models.capsules import Capsule
from whiptool.models.files import load_model, robot_looks
from whiptool.models.mount import mounted, with_stick
from whiptool.models.presets import preset
from whiptool.models.visuals import GREY, Look, Surface

CORNERS = np.array([[0.0, 0, 0], [0.1, 0, 0], [0, 0.2, 0], [0, 0, 0.3]])
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
SCALE, SHIFT, TURN = 0.5, np.array([0.01, 0.02, 0.03]), (0.1, 0.2, 0.3)
BALL = '<visual><origin xyz="0 0 0.02"/><geometry><sphere radius="0.01"/></geometry></visual>'
PLACED = '<origin xyz="0.01 0.02 0.03" rpy="0.1 0.2 0.3"/>'
MESH = '<mesh filename="package://robot/meshes/part.obj" scale="0.5 0.5 0.5"/>'
COLOUR = '<material name="red"><color rgba="0.8 0.1 0.2 1"/></material>'


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A tetrahedron, as a mesh."""
    (tmp_path / "meshes").mkdir()
    lines = [f"v {x} {y} {z}" for x, y, z in CORNERS] + [f"f {a} {b} {c}" for a, b, c in FACES + 1]
    (tmp_path / "meshes" / "part.obj").write_text("\n".join(lines) + "\n")
    return tmp_path


def urdf(folder: Path, mesh: str = MESH) -> Path:
    """The small robot with a mesh on its cart, and a ball on its tool, which is fixed to the last link."""
    text = URDF.replace('<mesh filename="package://nowhere/cart.dae"/>', mesh)
    text = text.replace("<visual><geometry>", f"<visual>{PLACED}<geometry>").replace(
        "</geometry></visual>", f"</geometry>{COLOUR}</visual>"
    )
    at = text.index('<link name="tool">') + len('<link name="tool">')
    path = folder / "small.urdf"
    path.write_text(text[:at] + BALL + text[at:])
    return path


def looks_of(path: Path | str, tip: str = "tool", **mounting: Any) -> list[Look] | None:
    """The looks of a robot as it is mounted."""
    arm = load_model(path, tip=tip if str(path).endswith((".urdf", ".xml")) else "").arm.in_space()
    return robot_looks(path, mounted(arm, **mounting) if mounting else arm, tip=tip)


def corners_of(surface: Surface | Capsule) -> np.ndarray:
    """The corners of the triangles of a mesh, sorted."""
    assert isinstance(surface, Surface)
    return np.unique(np.round(surface.vertices[surface.triangles].reshape(-1, 3), 6), axis=0)


def expected() -> np.ndarray:
    placed = SCALE * CORNERS @ Rotation.from_euler("xyz", TURN).as_matrix().T + SHIFT
    return np.unique(np.round(placed, 6), axis=0)


def test_meshes_of_a_urdf_are_placed_scaled_and_coloured(folder: Path) -> None:
    looks = looks_of(urdf(folder))
    assert looks is not None
    assert [len(look) for look in looks] == [0, 1, 0, 1]
    np.testing.assert_allclose(corners_of(looks[1][0]), expected(), atol=2e-6)
    assert isinstance(looks[1][0], Surface)
    np.testing.assert_allclose(looks[1][0].color, (0.8, 0.1, 0.2), atol=1e-6)
    ball = looks[3][0]
    assert isinstance(ball, Capsule)
    np.testing.assert_allclose(ball.start, (0.0, 0.02, 0.27), atol=1e-9)  # bracket, then the ball's own place


def test_a_mesh_whose_file_is_missing_is_left_out(folder: Path) -> None:
    looks = looks_of(urdf(folder, '<mesh filename="package://robot/meshes/absent.obj"/>'))
    assert looks is not None
    assert [len(look) for look in looks] == [0, 0, 0, 1]


def test_an_mjcf_looks_like_the_urdf(folder: Path) -> None:
    text = MJCF.replace("nowhere/cart.obj", "meshes/part.obj").replace(
        'name="cart" file', 'scale="0.5 0.5 0.5" name="cart" file'
    )
    placed = 'pos="0.01 0.02 0.03" euler="0.1 0.2 0.3" rgba="0.8 0.1 0.2 1"'
    text = text.replace('<compiler angle="radian"/>', '<compiler angle="radian" eulerseq="XYZ"/>')
    path = folder / "small.xml"
    path.write_text(text.replace('<geom type="mesh"', f'<geom {placed} type="mesh"'))
    looks = looks_of(path)
    assert looks is not None
    np.testing.assert_allclose(corners_of(looks[1][0]), expected(), atol=2e-6)
    assert isinstance(looks[1][0], Surface)
    np.testing.assert_allclose(looks[1][0].color, (0.8, 0.1, 0.2), atol=1e-6)


def test_a_model_file_names_its_robot_and_presets_have_no_meshes(folder: Path) -> None:
    arm = load_model(urdf(folder), tip="tool").arm
    model = folder / "model.toml"
    model.write_text('[arm]\nfile = "small.urdf"\ntip = "tool"\nmount = "ceiling"\n')
    looks = robot_looks(model, arm)
    assert looks is not None
    np.testing.assert_allclose(corners_of(looks[1][0]), expected(), atol=2e-6)
    assert looks_of("ur5e") is None
    model.write_text('name = "a"\n')
    assert robot_looks(model, arm) is None


def test_a_robot_without_visual_shapes_has_no_looks(folder: Path) -> None:
    text = URDF.replace('<visual><geometry><mesh filename="package://nowhere/cart.dae"/></geometry></visual>', "")
    (folder / "bare.urdf").write_text(text)
    assert looks_of(folder / "bare.urdf") is None


def test_what_cannot_be_read_is_refused_by_name(folder: Path) -> None:
    with pytest.raises(InputError, match="absent"):
        robot_looks(folder / "absent.urdf", preset("ur5e").arm)
    (folder / "small.xml").write_text(MJCF)
    with pytest.raises(InputError, match=r"file: got 'no model'.*cart\.obj"):
        looks_of(folder / "small.xml")


def test_what_has_no_colour_is_grey(folder: Path) -> None:
    path = urdf(folder)
    path.write_text(path.read_text().replace(COLOUR, ""))
    looks = looks_of(path)
    assert looks is not None
    assert isinstance(looks[1][0], Surface)
    assert looks[1][0].color == GREY


def test_the_base_turns_with_its_mounting_and_links_stay_in_their_frames(folder: Path) -> None:
    path = urdf(folder)
    text = path.read_text()
    visual = f"<visual>{PLACED}<geometry>{MESH}</geometry></visual>"
    path.write_text(text.replace('<link name="base">', f'<link name="base">{visual}', 1))
    floor, ceiling = looks_of(path), looks_of(path, given="ceiling", height=2.0)
    assert floor is not None
    assert ceiling is not None
    np.testing.assert_allclose(corners_of(floor[0][0]), expected(), atol=2e-6)
    half_turn = np.unique(np.round(expected() * [1, -1, -1], 6), axis=0)  # about x, as a robot hangs
    np.testing.assert_allclose(corners_of(ceiling[0][0]), half_turn, atol=2e-6)
    np.testing.assert_array_equal(corners_of(ceiling[1][0]), corners_of(floor[1][0]))


def test_a_stick_is_drawn_with_the_last_link(folder: Path) -> None:
    path = urdf(folder)
    path.write_text(path.read_text().replace('<link name="fore">', '<link name="fore"><collision><geometry>'
                    '<sphere radius="0.02"/></geometry></collision>'))  # fmt: skip
    arm = with_stick(load_model(path, tip="tool").arm.in_space(), length=0.5, mass=0.1)
    looks = robot_looks(path, arm, tip="tool")
    assert looks is not None
    assert looks[-1][-1] == arm.links[-1].capsules[-1]
