"""Derivatives of the parameter vector by named parameters, also of a whip's profile, by CasADi."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache

import casadi as ca
import numpy as np

from whiptool.dynamics.structure import Structure, arm_column
from whiptool.errors import InputError
from whiptool.impedance.controller import Controller
from whiptool.models.parameters import Model
from whiptool.models.profile import WhipProfile, lump, lumped_from

PROFILE = tuple(WhipProfile(1.0, 1.0, 1.0, 0.0).numbers)
LUMPED = ("l", "m", "k", "b", "rest_angle", "drag", "hinge_mass")  # what a profile gives


def profile_slopes(profile: WhipProfile, N: int, clamped: bool = False) -> dict[str, dict[str, np.ndarray]]:
    """Return the derivatives of the nodes' parameters (`whip.l`, ...) by each parameter of a profile (`profile.length`,
    ...).
    """
    jacobians = [J.full() for J in lumping(N, clamped)[1](np.array([*profile.numbers.values()]))]
    return {
        f"profile.{name}": {f"whip.{block}": J[:, i] for block, J in zip(LUMPED, jacobians, strict=True)}
        for i, name in enumerate(PROFILE)
    }


@lru_cache(maxsize=8)
def lumping(N: int, clamped: bool = False) -> tuple[ca.Function, ca.Function]:
    """Return a profile's node parameters, the blocks of `LUMPED`, as a function of its parameters, and their Jacobians.

    Both functions take one vector, in the order of the profile's fields. If the whip is clamped, the hinge has its
    share of the bending stiffness.
    """
    z = ca.SX.sym("profile", len(PROFILE))
    blocks = lump(dict(zip(PROFILE, ca.vertsplit(z), strict=True)), N, clamped=clamped, constant=ca.DM)
    of_profile = [ca.SX(blocks[name]) for name in LUMPED]
    jacobians = [ca.jacobian(block, z) for block in of_profile]
    return ca.Function("lump", [z], of_profile), ca.Function("slopes", [z], jacobians)


_FREE = "name it in `free` if its term is zero in this model"


def parameter_directions(
    structure: Structure, model: Model, controller: Controller, names: Sequence[str], of_strike: Mapping[str, int]
) -> np.ndarray:
    """Return the derivatives of the parameter vector by m named parameters, (m, P).

    The parameter vector is linear in all of them except those of a profile. For a whip with values per node, `whip.k`
    is their mean, and its change scales all values; see `Model.with_parameters`.

    Args:
        structure, model, controller: Structure, model and controller of the simulator.
        names: Names of the m parameters.
        of_strike: Column of each coordinate of a strike; -1: it has no common column, as it differs between strikes.

    Raises:
        InputError: A name is unknown, or its term is not part of the structure.
    """
    of_model = model.parameters() | {f"whip.{name}": model.whip.common(name) for name in model.whip.uneven}
    of_controller, rows = controller.parameters(), np.zeros((len(names), structure.n_parameters))
    none = np.zeros((1, sum(structure.strike_layout.values())))
    base = structure.pack(model, controller, none)[0]
    for row, name in zip(rows, names, strict=True):
        if name in of_strike:
            row[of_strike[name]] = of_strike[name] >= 0
        elif name in of_controller:
            block, _, index = name.rstrip("]").partition("[")
            row[structure.columns(block).start + int(index or 0)] = 1
        elif name.removeprefix("profile.") in PROFILE and name.startswith("profile."):
            _along_profile(row, structure, model, name)
        elif name in of_model and Structure.of(model, controller, free=[name]) in structure:
            if structure.arm is not None and name.startswith("arm."):
                quantity, column = arm_column(name)
                row[structure.columns(f"arm.{quantity}").start + column] = 1
                continue
            moved = model.with_parameters({name: of_model[name] + 1})
            row[:] = np.round(structure.pack(moved, controller, none)[0] - base, 12)
        else:
            known = [*of_strike, *(x for x in of_model if x.split("[")[0] in structure.layout), *of_controller]
            raise InputError("parameter", name, "one of " + ", ".join(known), _FREE if name in of_model else "")
    return rows


def _along_profile(row: np.ndarray, structure: Structure, model: Model, name: str) -> None:
    """Put the derivatives by a number of the whip's profile into a row (P,)."""
    profile = lumped_from(model.whip, clamped=model.whip.clamped)
    if profile is None:
        raise InputError("parameter", name, "numbers of a whip that is lumped from a profile without bead and waves")
    for block, slopes in profile_slopes(profile, model.whip.N, model.whip.clamped)[name].items():
        if block in structure.layout:
            row[structure.columns(block)] = slopes
        elif slopes.any():
            raise InputError("parameter", name, "one whose terms are part of this rollout", f"name {block} in `free`")
