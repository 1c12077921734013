"""Arms from URDF files: Pinocchio reads them."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from whiptool.errors import InputError
from whiptool.given_files import read_text
from whiptool.models.arm_choice import ArmChoice, quiet
from whiptool.models.capsules import Capsule
from whiptool.models.joint_names import joint_name
from whiptool.models.spatial_arm import JointLimits, SpatialArm, SpatialLink

_MOVABLE = ("revolute", "continuous", "prismatic")
_TYPES = (*_MOVABLE, "fixed")
_SIMPLE = ("box", "cylinder", "capsule", "sphere")  # shapes


def read_urdf(path: Path | str, choice: ArmChoice | None = None) -> SpatialArm:
    """Return the serial arm of a URDF file, its base frame that of the root link.

    Bodies on fixed or locked joints count with the link that carries them. Spheres, capsules, cylinders and boxes that
    are `<collision>` shapes are the arm's capsules: cylinders with round ends, boxes in the capsule that holds them;
    meshes are not looked at. A moving link without mass is a mere frame, as between two hinges at one point, if it has
    no shape. Dry friction of joints has no part in the model.

    Args:
        path: Of the file; xacro has to be expanded.
        choice: Which chain; default: all of a robot that does not branch, or the one to its only tool frame.

    Raises:
        InputError: The file cannot be read, is no tree of links, has joints of an unknown type or moving links without
            inertia, or does not have what was chosen.
    """
    choice = choice or ArmChoice()
    text = read_text(path, "URDF")
    try:
        parents = _tree(text)
        ends = [link for link in parents if link not in _carriers(parents)]
        moving = [link for link in ends if _movable(_path(parents, link))]
        tip = choice.only_tip(moving or ends, list(parents))
        movers = choice.movers(_movable(_path(parents, tip)), _movable(parents.values()))
        return _arm(text, choice, tip, movers)
    except InputError as error:
        raise error.within(f"{path}: ") from None


Parents = Mapping[str, "ET.Element | None"]  # the joint that each link hangs on, none at the root


def _tree(text: str) -> dict[str, ET.Element | None]:
    """Links and the joints that they hang on, checked to be one tree."""
    try:
        robot = ET.fromstring(text)
    except ET.ParseError as error:
        raise InputError("file", "no XML", f"a URDF file ({error})") from None
    if robot.tag != "robot":
        raise InputError("file", f"<{robot.tag}>", "a URDF file, which is a <robot>", "expand xacro first")
    parents: dict[str, ET.Element | None] = {link.get("name", ""): None for link in robot.findall("link")}
    for joint in robot.findall("joint"):
        name, kind = joint.get("name", ""), joint.get("type")
        for end in ("parent", "child"):
            if _end(joint, end) not in parents:
                raise InputError(f"joint {name}", f"{end} {_end(joint, end)}", "a link of the robot")
        if parents[_end(joint, "child")] is not None:
            rule = "a link on one joint only: a chain without loops"
            raise InputError(f"link {_end(joint, 'child')}", f"child of the joint {name} and of another", rule)
        parents[_end(joint, "child")] = joint
        if kind not in _TYPES:
            raise InputError(f"joint {name}", f"type {kind}", ", ".join(_TYPES))
    roots = [link for link, joint in parents.items() if joint is None]
    if len(roots) != 1:
        raise InputError(
            "links", roots or "a ring of links", "one root, on which all others hang: no loop, no part apart"
        )
    return parents


def _end(joint: ET.Element, end: str) -> str:
    found = joint.find(end)
    return "" if found is None else found.get("link", "")


def _carriers(parents: Parents) -> set[str]:
    return {_end(joint, "parent") for joint in parents.values() if joint is not None}


def _path(parents: Parents, tip: str) -> list[ET.Element]:
    """Joints from the root to the tip."""
    path: list[ET.Element] = []
    joint = parents[tip]
    while joint is not None:
        path.insert(0, joint)
        if len(path) > len(parents):
            raise InputError("links", tip, "a chain without loops")
        joint = parents[_end(joint, "parent")]
    return path


def _movable(joints: Any) -> list[str]:
    return [joint.get("name") for joint in joints if joint is not None and joint.get("type") in _MOVABLE]


def _arm(text: str, choice: ArmChoice, tip: str, movers: list[str]) -> SpatialArm:
    """The arm that Pinocchio reads, all joints but the movers locked."""
    import pinocchio as pin

    try:
        with quiet():
            whole = pin.buildModelFromXML(text)
    except (ValueError, RuntimeError) as error:
        raise InputError("file", "no robot", f"a URDF file that Pinocchio reads ({error})") from None
    at = np.zeros(whole.nv)
    for name, value in choice.locked.items():
        at[whole.idx_vs[whole.getJointId(name)]] = value
    locked = [i for i in range(1, whole.njoints) if whole.names[i] not in movers]
    posture = pin.integrate(whole, pin.neutral(whole), at)
    model, (shapes,) = pin.buildReducedModel(whole, [_shapes(whole, text)], locked, posture)
    data = model.createData()
    pin.forwardKinematics(model, data, pin.neutral(model))
    _check_masses(model, _shaped(text))
    capsules: list[list[Capsule]] = [[] for _ in range(model.njoints)]
    for shape in shapes.geometryObjects:
        capsules[shape.parentJoint].append(_capsule(shape))
    links = tuple(replace(_link(model, data, i), capsules=tuple(capsules[i])) for i in range(1, model.njoints))
    frame = model.frames[model.getFrameId(tip)]
    hand = frame.placement.rotation @ choice.hand
    x, y, z = frame.placement.translation.tolist()
    names = tuple(joint_name(name) for name in model.names[1:])
    return SpatialArm(links, names, (x, y, z), _rows(hand), base=tuple(capsules[0]))


def _shapes(model: Any, text: str) -> Any:
    """Return the simple collision shapes of a robot, as Pinocchio reads them."""
    import pinocchio as pin

    robot = ET.fromstring(text)
    for link in robot.findall("link"):
        for shape in link.findall("collision"):
            if not any(shape.find(f"geometry/{kind}") is not None for kind in _SIMPLE):
                link.remove(shape)
    simple = ET.tostring(robot, encoding="unicode")
    try:
        with quiet():
            return pin.buildGeomFromUrdfString(model, simple, pin.GeometryType.COLLISION)
    except (ValueError, RuntimeError) as error:
        raise InputError("file", "no shapes", f"a URDF file whose shapes Pinocchio reads ({error})") from None


def _capsule(shape: Any) -> Capsule:
    """Return the capsule that holds a simple shape, in its joint's frame."""
    import coal

    R, p, kind = shape.placement.rotation, shape.placement.translation, shape.geometry
    if isinstance(kind, coal.Box):
        return Capsule.around_box(R, p, np.array(kind.halfSide))
    return Capsule.along(R, p, float(getattr(kind, "halfLength", 0.0)), float(kind.radius))


def _shaped(text: str) -> set[str]:
    """Names of the links that have a shape: those are bodies, and no mere frames."""
    links = ET.fromstring(text).findall("link")
    return {x.get("name", "") for x in links if x.find("visual") is not None or x.find("collision") is not None}


def _check_masses(model: Any, shaped: set[str]) -> None:
    """Refuse joints that move nothing with a mass, and shapes without one.

    Raises:
        InputError: There is such a joint.
    """
    import pinocchio as pin

    beyond = 0.0
    for i in reversed(range(1, model.njoints)):
        mass = model.inertias[i].mass
        beyond += mass
        moved = {f.name for f in model.frames if f.parentJoint == i and f.type == pin.FrameType.BODY}
        if beyond <= 0 or (mass <= 0 and moved & shaped):
            rule = "an <inertial> with a mass > 0 on the link that it moves, or on one fixed to that"
            raise InputError(f"joint {model.names[i]}", f"mass {mass:g} kg", rule)


def _link(model: Any, data: Any, i: int) -> SpatialLink:
    """Joint i and what it moves."""
    v, q = model.idx_vs[i], model.idx_qs[i]
    body, place = model.inertias[i], model.jointPlacements[i]
    slide, turn = np.split(np.ravel(data.joints[i].S), 2)
    prismatic = bool(np.any(slide))
    bounded = model.nqs[i] == 1  # a continuous joint is a cosine and a sine
    ends = (model.lowerPositionLimit[q], model.upperPositionLimit[q]) if bounded else (-np.inf, np.inf)
    limits = JointLimits(
        position=(float(ends[0]), float(ends[1])),
        velocity=_limit(model.upperVelocityLimit[v]),
        torque=_limit(model.upperEffortLimit[v]),
    )
    I = body.inertia
    return SpatialLink(
        mass=float(body.mass),
        com=tuple(body.lever.tolist()) if body.mass else (0.0, 0.0, 0.0),
        inertia=tuple(I[(0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2)].tolist()),
        axis=tuple((slide if prismatic else turn).tolist()),
        position=tuple(place.translation.tolist()),
        rotation=_rows(place.rotation),
        kind="prismatic" if prismatic else "revolute",
        friction=float(model.damping[v]),
        armature=float(model.armature[v]),
        limits=limits,
    )


def _limit(given: float) -> float:
    """A limit as URDF gives it, where 0 says that there is none."""
    return float(given) if given > 0 else float("inf")


def _rows(rotation: np.ndarray) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(row) for row in rotation.tolist())
