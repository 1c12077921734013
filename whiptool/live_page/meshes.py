"""Meshes of links, of a target's cone and of an ellipsoid: vertices [m] and triangles, without a 3D library."""

from __future__ import annotations

import math

import numpy as np

from whiptool.models.capsules import Capsule
from whiptool.models.visuals import GREY, Surface

_AROUND, _ALONG = 20, 6  # points around an axis, and along a half sphere
MOST = 20_000  # triangles of a mesh, which a page sends to its browser
_CELLS, _COARSER = 512, 1.4  # along the longest side of a mesh that is simplified; how much fewer in the next try

Mesh = tuple[np.ndarray, np.ndarray]


def _revolved(profile: np.ndarray) -> Mesh:
    """Return the surface of a profile (P, 2) of radius and height, revolved about z: vertices and triangles."""
    angles = 2 * np.pi * np.arange(_AROUND) / _AROUND
    ring = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    vertices = np.concatenate(
        [profile[:, None, :1] * ring, np.broadcast_to(profile[:, None, 1:], (len(profile), _AROUND, 1))], axis=2
    )
    row, column = np.meshgrid(np.arange(len(profile) - 1), np.arange(_AROUND), indexing="ij")
    low, up = row * _AROUND + column, (row + 1) * _AROUND + column
    beside = (column + 1) % _AROUND - column
    faces = np.concatenate(
        [np.stack([low, low + beside, up], axis=-1), np.stack([up, low + beside, up + beside], axis=-1)]
    )
    return vertices.reshape(-1, 3), faces.reshape(-1, 3)


def _capsule(radius: float, length: float) -> Mesh:
    angles = np.linspace(-np.pi / 2, np.pi / 2, 2 * _ALONG)
    heights = radius * np.sin(angles) + np.where(angles > 0, length / 2, -length / 2)
    return _revolved(np.stack([radius * np.cos(angles), heights], axis=1))


def _cylinder(radius: float, length: float) -> Mesh:
    half = length / 2
    return _revolved(np.array([[0.0, -half], [radius, -half], [radius, half], [0.0, half]]))


def _box(halves: np.ndarray) -> Mesh:
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * halves
    faces = [(0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1)]
    faces += [(2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3)]
    return corners, np.array(faces)


def shape_mesh(shape: Capsule) -> Mesh:
    """Return the surface of a capsule, cylinder, box or hull in its link's frame."""
    if shape.hull:
        solid = shape.solid()
        corners = (solid.polygons(i) for i in range(solid.num_polygons))
        vertices, faces = solid.points(), np.array([[polygon[k] for k in range(3)] for polygon in corners])
    elif shape.width is not None:
        across = float(np.linalg.norm(shape.width))
        vertices, faces = _box(np.array([across, math.sqrt(shape.radius**2 - across**2), shape.length / 2]))
    elif shape.flat:
        vertices, faces = _cylinder(shape.radius, shape.length)
    else:
        vertices, faces = _capsule(shape.radius, shape.length)
    centre = (np.array(shape.start) + np.array(shape.end)) / 2
    return vertices @ shape.rotation.T + centre, faces


def rod_mesh(radius: float, length: float) -> Mesh:
    """Return a rod with round ends from the origin along z."""
    vertices, faces = _capsule(radius, length)
    return vertices + np.array([0.0, 0.0, length / 2]), faces


def joined(meshes: list[Mesh]) -> Mesh:
    """Return several meshes as one; there is at least one."""
    firsts = np.cumsum([0, *(len(vertices) for vertices, _ in meshes)])
    faces = [triangles + first for (_, triangles), first in zip(meshes, firsts, strict=False)]
    return np.concatenate([vertices for vertices, _ in meshes]), np.concatenate(faces)


def simplified(mesh: Mesh, most: int = MOST) -> Mesh:
    """Return a mesh of at most `most` triangles: one itself, or its vertices in each cell of a grid made one.

    Source: Rossignac and Borrel 1993, Multi-resolution 3D approximations for rendering complex scenes.
    """
    vertices, faces = mesh
    size = float(np.ptp(vertices, axis=0).max()) if len(vertices) else 0.0
    found, cell = mesh, size / _CELLS
    while len(found[1]) > most:
        _, first, which = np.unique(np.floor(vertices / cell), axis=0, return_index=True, return_inverse=True)
        corners = which.reshape(-1)[faces]
        flat = (corners == np.roll(corners, 1, axis=1)).any(axis=1)
        found, cell = (vertices[first], np.unique(corners[~flat], axis=0)), _COARSER * cell
    return found


def drawn_mesh(shape: Surface | Capsule) -> tuple[Mesh, tuple[float, float, float]]:
    """Return the mesh of a robot's visual shape as a page draws it, and its colour, 0 to 1."""
    if isinstance(shape, Capsule):
        return shape_mesh(shape), GREY
    return simplified(shape.mesh), shape.color


def cone_mesh(apex: np.ndarray, direction: np.ndarray, half_angle: float, length: float) -> Mesh:
    """Return the cone of directions that arrive at a point: its apex is there, and it opens against the direction.

    Args:
        apex: The point [m], (3,).
        direction: Unit vector of the axis, (3,).
        half_angle: Half angle [rad], below pi / 2.
        length: Length along the axis [m].
    """
    vertices, faces = _revolved(np.array([[0.0, 0.0], [length * math.tan(half_angle), -length]]))
    return apex + vertices @ frame_along(direction).T, faces


def frame_along(direction: np.ndarray) -> np.ndarray:
    """Return a rotation (3, 3) whose last axis is a unit vector (3,)."""
    x = np.eye(3)[np.abs(direction).argmin()]
    x = x - (x @ direction) * direction
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(direction, x), direction])


def ellipsoid_mesh(centre: np.ndarray, axes: np.ndarray) -> Mesh:
    """Return an ellipsoid.

    Args:
        centre: Its centre [m], (3,).
        axes: Its half axes [m], one in each column, (3, 3).
    """
    vertices, faces = _capsule(1.0, 0.0)
    turned = axes if np.linalg.det(axes) >= 0 else axes * np.array([1.0, 1.0, -1.0])
    return centre + vertices @ turned.T, faces


def ellipse_points(centre: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """Return a closed line around an ellipse (49, d) [m].

    Args:
        centre: Its centre [m], (d,).
        axes: Its two half axes, one in each column [m], (d, 2).
    """
    angles = np.linspace(0, 2 * np.pi, 49)
    return centre + np.stack([np.cos(angles), np.sin(angles)], axis=1) @ axes.T
