"""Meshes that are too large for a page are drawn coarser, where they are."""

from __future__ import annotations

import numpy as np
import pytest

from whiptool.live_page.meshes import MOST, ellipsoid_mesh, shape_mesh, simplified
from whiptool.models.capsules import Capsule


def sphere(rings: int) -> tuple[np.ndarray, np.ndarray]:
    """A sphere of radius 0.1 m about (1, 0, 0) m of 2 rings^2 triangles."""
    polar, around = np.meshgrid(np.linspace(0, np.pi, rings + 1), np.linspace(0, 2 * np.pi, rings + 1), indexing="ij")
    points = np.stack([np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around), np.cos(polar)], axis=-1)
    i, j = (x.ravel() for x in np.meshgrid(np.arange(rings), np.arange(rings), indexing="ij"))
    a, b, c, d = (y * (rings + 1) + x for y, x in ((i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)))
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    return 0.1 * points.reshape(-1, 3) + [1.0, 0.0, 0.0], faces


def area(mesh: tuple[np.ndarray, np.ndarray]) -> float:
    a, b, c = mesh[0][mesh[1]].transpose(1, 0, 2)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def test_a_large_mesh_has_fewer_triangles_and_the_same_form():
    fine = sphere(300)
    assert len(fine[1]) > 5 * MOST
    coarse = simplified(fine)
    assert MOST / 4 < len(coarse[1]) <= MOST
    np.testing.assert_allclose(np.linalg.norm(coarse[0] - [1.0, 0.0, 0.0], axis=1), 0.1, rtol=1e-9)
    assert area(coarse) == pytest.approx(area(fine), rel=0.02)


def test_a_small_mesh_is_left_as_it_is():
    mesh = ellipsoid_mesh(np.zeros(3), np.eye(3))
    assert simplified(mesh) is mesh


def test_a_hull_is_drawn_where_it_is():
    """A tetrahedron, of which the corners and the area are known."""
    corners = np.array([[1.0, 2.0, 3.0], [1.1, 2.0, 3.0], [1.0, 2.1, 3.0], [1.0, 2.0, 3.1]])
    mesh = shape_mesh(Capsule.around(corners))
    assert np.array(sorted(map(tuple, mesh[0].tolist()))) == pytest.approx(
        np.array(sorted(map(tuple, corners.tolist())))
    )
    assert area(mesh) == pytest.approx(0.005 * (3 + np.sqrt(3)))
