"""Random arms in space, and a whip for them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from whiptool.models import JointLimits, Model, SpatialArm, SpatialLink, WhipParameters, preset
from whiptool.models.presets import rope


def rotation(rng: np.random.Generator) -> np.ndarray:
    """A random rotation, (3, 3)."""
    R, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return R * np.sign(np.linalg.det(R))


def inertia(rng: np.random.Generator, size: float = 0.01) -> tuple[float, ...]:
    """Moments of a body of random points, which no triangle of principal moments forbids."""
    x = rng.normal(size=(6, 3)) * np.sqrt(size)
    J = (x**2).sum() * np.eye(3) - x.T @ x
    return tuple(J[(0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2)].tolist())


def random_arm(
    n: int, rng: np.random.Generator, *, massless: tuple[int, ...] = (), prismatic: tuple[int, ...] = ()
) -> SpatialArm:
    """An arm of n joints in random places, some links of it massless, some joints sliding."""
    links = []
    for i in range(n):
        body = (0.0, (0, 0, 0), (0,) * 6)
        if i not in massless:
            body = (rng.uniform(0.5, 2), tuple(0.1 * rng.normal(size=3)), inertia(rng))
        axis = rng.normal(size=3)
        links.append(
            SpatialLink(
                *body,
                axis=tuple(axis / np.linalg.norm(axis)),
                position=tuple(0.2 * rng.normal(size=3)),
                rotation=tuple(map(tuple, rotation(rng))),
                kind="prismatic" if i in prismatic else "revolute",
                friction=rng.uniform(0.01, 0.2),
                armature=rng.uniform(0.01, 0.1),
                limits=JointLimits(position=(-1.0, 1.5), velocity=3.0, torque=50.0),
            )
        )
    return SpatialArm(
        tuple(links), hand_position=tuple(0.2 * rng.normal(size=3)), hand_rotation=tuple(map(tuple, rotation(rng)))
    )


def random_model(n: int, rng: np.random.Generator, **arm) -> Model:
    """A random arm with a whip of four universal nodes and a mass on its hinge."""
    whip = WhipParameters(
        N=4, l=0.1, m=0.02, k=0.2, b=0.01, joints="universal", node_inertia=1e-6, hinge_mass=0.07, dry_friction=0.003,
        drag=0.01, drag_ratio=0.2, cubic_stiffness=0.05,
    )  # fmt: skip
    return Model(whip, random_arm(n, rng, **arm), gravity=8.0, name=f"{n} joints in space")


ARMS = {
    "one joint": {"n": 1},
    "three joints": {"n": 3},
    "shoulder of massless links": {"n": 4, "massless": (0, 1)},
    "a slide among hinges": {"n": 5, "prismatic": (2,)},
    "massless links in the middle and at the end": {"n": 7, "massless": (2, 3, 6), "prismatic": (3, 5)},
}


def of_universal_nodes(name: str) -> Model:
    """A robot of the presets whose rope is of universal nodes."""
    return replace(preset(name), whip=rope(joints="universal"))
