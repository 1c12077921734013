"""The same whip, longer or shorter, of more or fewer nodes, or tapered."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from whiptool.errors import InputError
from whiptool.models.numbers import metres, number, whole
from whiptool.models.profile import even_profile, lumped_from
from whiptool.models.whip import PerNode, WhipParameters

# How numbers of a node grow with the length of its link where the whip's material stays the same: their power of it
_POWERS = {
    "l": 1, "m": 1, "drag": 1, "hinge_mass": 1, "node_inertia": 1,
    "k": -1, "b": -1, "cubic_stiffness": -3, "dry_friction": 0,
    "rest_angle": 1, "rest_angle_x": 1, "friction_velocity": 1,
}  # fmt: skip
_BESIDE_PROFILE = ("node_inertia", "cubic_stiffness", "dry_friction", "rest_angle_x", "friction_velocity")
_OF_THICKNESS = {
    "density_taper": 2,
    "stiffness_taper": 4,
    "damping_taper": 4,
}  # powers of it, of a round whip


def resized(
    whip: WhipParameters, *, length: float | None = None, nodes: int | None = None, taper: float | None = None
) -> WhipParameters:
    """Return a whip of the same material with another length, number of nodes or taper.

    Mass, bending stiffness, damping and drag per length are kept. The nodes of a whip that was computed from a profile
    are computed again; those of others are scaled with the length of their links.

    Args:
        whip: The original whip.
        length: Length of the stretched whip [m]; None: unchanged.
        nodes: Number of nodes; None: unchanged.
        taper: Ratio of the thickness at the tip to that at the handle, which is kept; as for a round whip, mass scales
            with its square, bending stiffness and damping with its fourth power. None: unchanged.

    Raises:
        InputError: A number is out of range, or the nodes differ in a way that no profile describes, so that only the
            length can be changed.
    """
    N = whip.N if nodes is None else whole("nodes", nodes, high=200)
    L = whip.length if length is None else metres("length", length)
    growth = (L / N) / (whip.length / whip.N)
    profile = lumped_from(whip, clamped=whip.clamped)
    if profile is None and taper is not None:
        profile = even_profile(whip)
    names = _POWERS if profile is None else _BESIDE_PROFILE
    if N != whip.N and (uneven := [name for name in names if isinstance(getattr(whip, name), tuple)]):
        fix = "make the whip of a WhipProfile, which is lumped into any number"
        raise InputError("nodes", nodes, f"{whip.N}, as whip.{uneven[0]} is given node by node", fix)
    scaled = {name: _times(getattr(whip, name), growth ** _POWERS[name]) for name in names}
    if profile is None:
        return replace(whip, N=N, **scaled)
    lumped = profile.changed({"length": L, **_tapers(taper)}).lump(N, joints=whip.joints, clamped=whip.clamped)
    return replace(lumped, drag_ratio=whip.drag_ratio, **scaled)


def of_other_profile(whip: WhipParameters, changes: Mapping[str, float]) -> WhipParameters:
    """Return a whip with nodes computed again from its profile with some parameters changed; all else is kept.

    Raises:
        InputError: The whip was not computed from a profile, a name is unknown, or a value is not allowed.
    """
    profile = lumped_from(whip, clamped=whip.clamped)
    if profile is None:
        rule = "numbers of a whip that is lumped from a profile without bead and waves"
        raise InputError("parameter", ", ".join(f"profile.{name}" for name in changes), rule)
    kept = {name: getattr(whip, name) for name in ("drag_ratio", *_BESIDE_PROFILE)}
    return replace(profile.changed(changes).lump(whip.N, joints=whip.joints, clamped=whip.clamped), **kept)


def _times(value: PerNode, factor: float) -> Any:
    return tuple(factor * x for x in value) if isinstance(value, tuple) else factor * value


def _tapers(taper: float | None) -> Mapping[str, float]:
    """The tapers of a profile of a round whip's thickness."""
    if taper is None:
        return {}
    thickness = number("taper", taper, low=0.03, high=30)
    return {name: thickness**power for name, power in _OF_THICKNESS.items()}
