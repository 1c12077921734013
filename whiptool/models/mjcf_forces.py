"""Forces in MJCF files: the torques of motors, and notes on joint forces that the model does not have."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import mujoco
import numpy as np

from whiptool.errors import InputError

_STRAINS = ("stiffness", "stiffnesspoly", "damping", "dampingpoly", "frictionloss", "armature")  # of tendons


def refuse_tendons(
    model: Any, movers: Sequence[int], names: Sequence[str], joints_to: Callable[[int], list[int]]
) -> None:
    """Refuse tendons that exert forces on joints of the arm: limited ones, parts of equalities, or those with
    stiffness, damping, friction or inertia. Those that only measure or are beyond the tip are ignored.
    """
    in_equality = {
        tendon
        for i in range(model.neq)
        if model.eq_active0[i] and model.eq_type[i] == int(mujoco.mjtEq.mjEQ_TENDON)
        for tendon in (int(model.eq_obj1id[i]), int(model.eq_obj2id[i]))
    }
    for i in range(model.ntendon):
        strained = [name for name in _STRAINS if np.any(getattr(model, f"tendon_{name}")[i])]
        does = ["an equality"] * (i in in_equality) + ["a range"] * bool(model.tendon_limited[i]) + strained
        moved = _joints_of_tendon(model, i, joints_to)
        held = [names[j] for j in movers if j in moved]
        if does and held:
            given = f"{does[0].removesuffix('poly')}, over {', '.join(names[j] for j in sorted(moved))}"
            rule = "tendons without forces on the joints between base and tip"
            fix = f"take it out of the file, or lock {', '.join(held)} in a model file"
            raise InputError(f"tendon {model.tendon(i).name or i}", given, rule, fix)


def _joints_that_follow(model: Any, movers: Sequence[int], names: Sequence[str]) -> list[str]:
    """Note on the joints beyond the arm which an equality couples to joints of the arm."""
    tied = [
        names[model.eq_obj1id[i]]
        for i in range(model.neq)
        if model.eq_active0[i] and model.eq_type[i] == int(mujoco.mjtEq.mjEQ_JOINT) and model.eq_obj2id[i] in movers
    ]
    held = f"what an equality ties to joints of the arm does not move with them, but is held: {', '.join(tied)}"
    return [held] if tied else []


def _pulled_elsewhere(
    model: Any, movers: Sequence[int], names: Sequence[str], joints_to: Callable[[int], list[int]]
) -> list[str]:
    """Note on the arm's joints with actuators on tendons or sites, whose limits cannot be assigned to one joint."""
    places: dict[str, set[int]] = {}
    for i in _switched_on(model):
        kind, (one, other) = mujoco.mjtTrn(model.actuator_trntype[i]), model.actuator_trnid[i].tolist()
        if kind == mujoco.mjtTrn.mjTRN_TENDON:
            places.setdefault("tendons", set()).update(_joints_of_tendon(model, one, joints_to))
        elif kind in (mujoco.mjtTrn.mjTRN_SITE, mujoco.mjtTrn.mjTRN_SLIDERCRANK):
            first, second = (set(joints_to(int(model.site_bodyid[x]))) if x >= 0 else set() for x in (one, other))
            places.setdefault("sites", set()).update(first ^ second)
    of = ", ".join(names[i] for i in movers if any(i in joints for joints in places.values()))
    return [f"actuators that pull at {' and '.join(places)} limit no torque here: of {of}"] if of else []


def _joints_of_tendon(model: Any, tendon: int, joints_to: Callable[[int], list[int]]) -> set[int]:
    """Joints that change a tendon's length."""
    joints, bodies = set(), []
    for wrap in range(model.tendon_adr[tendon], model.tendon_adr[tendon] + model.tendon_num[tendon]):
        kind, thing = mujoco.mjtWrap(model.wrap_type[wrap]), int(model.wrap_objid[wrap])
        if kind == mujoco.mjtWrap.mjWRAP_JOINT:
            joints.add(thing)
        elif kind == mujoco.mjtWrap.mjWRAP_SITE:
            bodies.append(set(joints_to(int(model.site_bodyid[thing]))))
        elif kind in (mujoco.mjtWrap.mjWRAP_SPHERE, mujoco.mjtWrap.mjWRAP_CYLINDER):
            bodies.append(set(joints_to(int(model.geom_bodyid[thing]))))
    return joints | (set.union(*bodies) - set.intersection(*bodies) if bodies else set())


def notes_on_forces(
    model: Any,
    movers: Sequence[int],
    names: Sequence[str],
    bodies: Mapping[int, str],
    joints_to: Callable[[int], list[int]],
) -> list[str]:
    """Return notes on the forces in a file that the arm's model ignores, one line for each kind.

    `movers` are the indices of the arm's joints, `bodies` the names of the bodies that the arm moves, by index, and
    `joints_to` returns the indices of the joints between the world and a body.
    """

    def of(has: Callable[[int], Any]) -> str:
        return ", ".join(names[i] for i in movers if np.any(has(i)))

    springs = of(lambda i: [model.jnt_stiffness[i], *model.jnt_stiffnesspoly[i]])
    rubbing = of(lambda i: model.dof_frictionloss[model.jnt_dofadr[i]])
    bent = of(lambda i: model.dof_dampingpoly[model.jnt_dofadr[i]])
    balanced = ", ".join(name for i, name in bodies.items() if model.body_gravcomp[i])
    air = " and ".join(name for name in ("density", "viscosity") if getattr(model.opt, name))
    notes = {
        f"springs of the joints {springs} (stiffness) have no part in the model": springs,
        f"dry friction of {rubbing} (frictionloss) has no part in the model, only viscous damping has": rubbing,
        f"of the damping of {bent} only what grows with the speed itself counts, no higher powers": bent,
        f"gravcomp of {balanced} has no part in the model: the joints bear the whole weight": balanced,
        f"{air} of <option> has no part in the model: the arm moves without drag": air,
    }
    found = [note for note, there in notes.items() if there]
    found += _joints_that_follow(model, movers, names) + _unread_actuators(model, movers, names)
    return found + _pulled_elsewhere(model, movers, names, joints_to)


def torque_note(model: Any, joint: int, name: str, slides: bool) -> list[str]:
    """Return a note if a joint's torque limits differ between the two directions."""
    low, high = _torques(model, joint)
    if np.isclose(-low, high):
        return []
    unit, taken = "N" if slides else "N m", torque(model, joint)
    return [f"{name} has {low:g} to {high:g} {unit} in the file: {taken:g} {unit} is taken for both directions"]


def torque(model: Any, joint: int) -> float:
    """Return the largest torque or force in both directions; of a range that begins or ends at 0, in the other one."""
    low, high = sorted(np.abs(_torques(model, joint)).tolist())
    return low or high


def _torques(model: Any, joint: int) -> tuple[float, float]:
    """Lowest and highest torque that the motors at a joint give together, within what the joint itself allows."""
    ends = model.jnt_actfrcrange[joint].tolist() if model.jnt_actfrclimited[joint] else (-np.inf, np.inf)
    own = [i for i in _motors(model, joint) if not _unread(model, i)]
    low, high = np.clip(np.sum([_forces(model, i) for i in own], axis=0), *ends).tolist() if own else ends
    return low, high


def _unread_actuators(model: Any, movers: Sequence[int], names: Sequence[str]) -> list[str]:
    """Note on the actuators at joints of the arm that are no motors of a known largest torque."""
    found: dict[str, list[str]] = {}
    for j in movers:
        for kind in {_unread(model, i) for i in _motors(model, j)} - {""}:
            found.setdefault(kind, []).append(names[j])
    said = " and ".join(f"{kind}s of {', '.join(of)}" for kind, of in sorted(found.items()))
    return [f"{said} (actuators) have no part in the model, and limit no torque here"] if said else []


def _switched_on(model: Any) -> list[int]:
    """Actuators of the groups that are not disabled; none where actuation is."""
    if model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_ACTUATION):
        return []
    return [i for i in range(model.nu) if not model.opt.disableactuator >> int(model.actuator_group[i]) & 1]


def _motors(model: Any, joint: int) -> list[int]:
    """Actuators at a joint."""
    kinds = [int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT)]
    at = [i for i in _switched_on(model) if model.actuator_trntype[i] in kinds and model.actuator_trnid[i, 0] == joint]
    return [i for i in at if model.actuator_gear[i, 0]]


def _unread(model: Any, actuator: int) -> str:
    """Kind of an actuator that is not read; empty for others."""
    kind, gain = mujoco.mjtGain(model.actuator_gaintype[actuator]), model.actuator_gainprm[actuator]
    if kind == mujoco.mjtGain.mjGAIN_AFFINE:
        return "" if gain[0] or gain[1] or model.actuator_biastype[actuator] else "damper"
    known = (mujoco.mjtGain.mjGAIN_FIXED, mujoco.mjtGain.mjGAIN_PID)
    return "" if kind in known else {"dcmotor": "DC motor"}.get(name := kind.name[7:].lower(), name)


def _forces(model: Any, actuator: int) -> list[float]:
    """Lowest and highest force of an actuator at its joint: all bounds that it states hold at once."""
    gear, gain = (float(x[actuator, 0]) for x in (model.actuator_gear, model.actuator_gainprm))
    dynamics, bounds = mujoco.mjtDyn(model.actuator_dyntype[actuator]), []
    if model.actuator_gaintype[actuator] == int(mujoco.mjtGain.mjGAIN_FIXED) and not model.actuator_biastype[actuator]:
        follows = dynamics in (mujoco.mjtDyn.mjDYN_NONE, mujoco.mjtDyn.mjDYN_FILTER, mujoco.mjtDyn.mjDYN_FILTEREXACT)
        if model.actuator_ctrllimited[actuator] and follows:
            bounds.append(np.sort(gain * model.actuator_ctrlrange[actuator]))
        if model.actuator_actlimited[actuator] and dynamics != mujoco.mjtDyn.mjDYN_NONE:
            bounds.append(np.sort(gain * model.actuator_actrange[actuator]))
    if model.actuator_forcelimited[actuator]:
        bounds.append(model.actuator_forcerange[actuator])
    ends = np.array([-np.inf, np.inf])
    for low, high in bounds:
        ends = np.clip(ends, low, high)
    return sorted((gear * ends).tolist())
