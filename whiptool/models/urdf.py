"""Arms from URDF files, with notes on assumptions and ignored parts."""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from whiptool.errors import InputError
from whiptool.models.capsules import Capsule
from whiptool.models.numbers import LARGEST
from whiptool.models.robot_files import ArmChoice, read_urdf_text
from whiptool.models.spatial_arm import (
    MOMENTS,
    JointLimits,
    RigidBody,
    SpatialArm,
    SpatialLink,
    is_possible,
    joint_name,
    welded,
    without_inertia,
)
from whiptool.models.urdf_limits import (
    RESERVES,
    by_position,
    keeps_off,
    number_of,
    position_limits,
    with_all_limits,
    zero_limit,
)
from whiptool.models.urdf_numbers import MOVABLE, check_numbers, plain_urdf, rotor_inertias
from whiptool.models.urdf_shapes import (
    DENSITY,
    add_inertias,
    capsule_of,
    look_of,
    massless_links,
    shaped_links,
    simple_shapes,
    visual_shapes,
    with_meshes,
)
from whiptool.models.visuals import Look, Surface


def assumed(
    robot: ET.Element,
    movers: Collection[str],
    moved: Collection[str],
    weighed: Collection[str],
    without_mass: Sequence[str],
    known: bool,
) -> tuple[str, ...]:
    """Return notes on assumptions about a URDF file and on its ignored parts, one line for each kind.

    `movers` and `moved` name the arm's joints and links, the base included; `weighed` moving links with the mass of
    their shapes; `without_mass` joints whose links have an inertia only; `known`: whether the inertia of all is.
    """

    def of(has: Callable[[ET.Element], bool]) -> str:
        joints = [joint for joint in robot.findall("joint") if joint.get("name") in movers and has(joint)]
        return ", ".join(joint.get("name", "") for joint in joints)

    def follow(joint: ET.Element) -> bool:
        mimic = joint.find("mimic")
        return mimic is not None and mimic.get("joint") in movers

    light, water = ", ".join(without_mass), ", ".join(sorted(weighed))
    following = ", ".join(joint.get("name", "") for joint in robot.findall("joint") if follow(joint))
    soft, free, meshes = of(keeps_off), of(zero_limit), ", ".join(sorted(with_meshes(robot) & set(moved)))
    rubbing, slowed = of(_rubs), of(by_position)
    held = ", ".join(joint.get("name", "") for joint in robot.findall("joint") if joint.get("type") in _FREE)
    shared = ", ".join(rotor_inertias(robot)[1])
    guess = ", a guess that torques depend on" if known else ""
    said = {
        f"no <inertial> in {water}: taken as {DENSITY:g} kg/m3 of their shapes{guess}": water,
        f"the inertia of what {light} moves is left out, as its mass is 0: no body has one without the other": light,
        f"speed limits that depend on the position of {slowed} keep {RESERVES}; arm.limits changes that": slowed,
        f"what mimics joints of the arm does not move with them, but is held: {following}": following,
        f"a velocity or effort of 0 or less in the <limit> of {free} is taken as no limit": free,
        f"collision shapes of {meshes} that are meshes are not looked at: nothing is judged to touch them": meshes,
        f"soft limits of {soft} (<safety_controller>) are not kept, only those of <limit>": soft,
        f"what hangs on joints that move freely is held where it is with them at 0: {held}": held,
        f"rotor inertias of the transmissions {shared} are not read, as each moves several joints": shared,
        f"dry friction of {rubbing} has no part in the model, only its damping has": rubbing,
    }
    return tuple(note for note, names in said.items() if names)


def _rubs(joint: ET.Element) -> bool:
    """Whether a joint has dry friction."""
    return number_of(joint.find("dynamics"), "friction") > 0


_TYPES = (*MOVABLE, "fixed")
_FREE = ("floating", "planar")  # types of joints that are held, if what moves is named


def read_urdf(path: Path | str, choice: ArmChoice | None = None) -> SpatialArm:
    """Return the serial arm of a URDF file, its base frame that of the root link.

    Bodies on fixed or locked joints are part of the link that carries them. `<collision>` spheres, capsules, cylinders
    and boxes become the arm's capsules; meshes are ignored. A moving link without mass and shape is treated as a frame,
    as between two hinges at one point. A link with a shape but without mass gets the mass that its shapes or meshes
    would have if made of water; if mesh files are missing, its joint is listed in `weightless`. Dry friction of joints
    is ignored. The arm's `notes` list these assumptions.

    Args:
        path: Path of the file; xacro files have to be expanded first.
        choice: Chain of the robot; default: the whole robot if it does not branch, else the chain to its only tool
            frame.

    Raises:
        InputError: The file cannot be read or is not a tree of links; a number in it cannot be read, or an inertia is
            impossible; it has joints of an unknown type; joints in the chain mimic others, have no range, or move
            freely, unless `choice.moving` names those that move; or a chosen name does not exist.
    """
    choice = choice or ArmChoice()
    text = read_urdf_text(path)
    try:
        robot, tip, movers = _chosen(text, choice)
        return _arm(robot, Path(path).parent, choice, tip, movers)
    except InputError as error:
        raise error.within(f"{path}: ") from None


def read_urdf_looks(path: Path | str, choice: ArmChoice | None = None) -> list[Look]:
    """Return the visual shapes of the base and of each link of the arm of `read_urdf`, in their frames, (a + 1,);
    meshes whose files are missing are left out.
    """
    choice = choice or ArmChoice()
    text = read_urdf_text(path)
    try:
        robot, _, movers = _chosen(text, choice)
        _tell_apart(robot)
        whole = _whole(robot)
        model, shapes = _reduced(whole, robot, choice, movers, visual_shapes(whole, robot, Path(path).parent))
    except InputError as error:
        raise error.within(f"{path}: ") from None
    looks: list[list[Surface | Capsule]] = [[] for _ in range(model.njoints)]
    for shape in shapes.geometryObjects:
        looks[shape.parentJoint].append(look_of(shape))
    return list(looks)


def _chosen(text: str, choice: ArmChoice) -> tuple[ET.Element, str, list[str]]:
    """The robot, the link that is its tip, and the joints that move."""
    robot = _robot(text)
    parents = _tree(robot)
    check_numbers(robot)
    ends = [link for link in parents if link not in _carriers(parents)]
    moving = [link for link in ends if _movable(_path(parents, link))]
    tip = choice.only_tip(moving or ends, list(parents))
    movers = choice.movers(_movable(_path(parents, tip)), _movable(parents.values()))
    for joint in _path(parents, tip):
        if joint.get("name") in movers:
            _check_moving(joint)
        elif joint.get("type") in _FREE and choice.moving is None:
            fix = f"to hold it, write arm.moving = {movers} in a model file, or moving={movers} in Python"
            raise InputError(f"joint {joint.get('name')}", f"type {joint.get('type')}", ", ".join(_TYPES), fix)
    return robot, tip, movers


Parents = Mapping[str, "ET.Element | None"]  # the joint that each link hangs on, none at the root


def _robot(text: str) -> ET.Element:
    """The file's XML; prefixes of names that nothing declares, as exporters write, are."""
    try:
        robot = ET.fromstring(text.strip())
        for element in robot.iter():
            element.tag = element.tag.rpartition("}")[2]  # without its namespace
        return robot
    except ET.ParseError as error:
        undeclared = set(re.findall(r"[<\s/]([A-Za-z_][\w.-]*):[A-Za-z_]", text)) - {"xml", "xmlns"}
        declared = " ".join(
            f'xmlns:{prefix}="{prefix}"' for prefix in sorted(undeclared) if f"xmlns:{prefix}" not in text
        )
        if "unbound prefix" in str(error) and declared:
            return _robot(re.sub(r"<robot\b", f"<robot {declared}", text, count=1))
        raise InputError("file", "no XML", "a URDF file", f"reason: {error}") from None


def _tree(robot: ET.Element) -> dict[str, ET.Element | None]:
    """Links and the joints that they hang on, checked to be one tree."""
    if robot.tag != "robot":
        raise InputError("file", f"<{robot.tag}>", "a URDF file with the root element <robot>", "expand xacro first")
    parents: dict[str, ET.Element | None] = {link.get("name", ""): None for link in robot.findall("link")}
    if not parents:
        raise InputError("links", "none", "a <robot> with one or more <link>", "expand xacro first")
    for joint in robot.findall("joint"):
        name, kind = joint.get("name", ""), joint.get("type")
        for end in ("parent", "child"):
            if _end(joint, end) not in parents:
                raise InputError(f"joint {name}", f"{end} {_end(joint, end)}", "a link of the robot")
        if parents[_end(joint, "child")] is not None:
            rule = "a link on one joint only: a chain without loops"
            raise InputError(f"link {_end(joint, 'child')}", f"child of the joint {name} and of another", rule)
        parents[_end(joint, "child")] = joint
        if kind not in (*_TYPES, *_FREE):
            raise InputError(f"joint {name}", f"type {kind}", ", ".join(_TYPES))
    roots = [link for link, joint in parents.items() if joint is None]
    if len(roots) != 1:
        raise InputError("links", roots or "a ring of links", "a single tree of links, without loops")
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
    return [joint.get("name") for joint in joints if joint is not None and joint.get("type") in MOVABLE]


def _check_moving(joint: ET.Element) -> None:
    """Refuse a joint that cannot be moved on its own."""
    name, mimic, limit = joint.get("name", ""), joint.find("mimic"), joint.find("limit")
    fix = f"choose a tip before it, or write arm.locked = {{ {name} = 0 }} in a model file"
    if mimic is not None:
        rule = "joints between base and tip that mimic no other joint"
        raise InputError(f"joint {name}", f"a mimic of {mimic.get('joint')}", rule, fix)
    axis = joint.find("axis")
    if axis is not None and not any(map(float, axis.get("xyz", "1").split())):
        raise InputError(f"joint {name}", "an <axis> of 0 0 0", "a direction", fix)
    if joint.get("type") == "continuous":
        return
    ends = [number_of(limit, end) for end in ("lower", "upper")]
    if not ends[0] < ends[1]:
        rule = 'a <limit> whose lower is below its upper, or type="continuous"'
        raise InputError(f"joint {name}", f"lower {ends[0]:g} and upper {ends[1]:g}", rule, fix)


def _arm(robot: ET.Element, folder: Path, choice: ArmChoice, tip: str, movers: list[str]) -> SpatialArm:
    """The arm that Pinocchio reads, all joints but the movers locked."""
    import pinocchio as pin

    tip = _tell_apart(robot).get(tip, tip)
    whole = _whole(robot)
    main = {_end(joint, "child") for joint in robot.findall("joint") if joint.get("name") in movers}
    weighed = add_inertias(whole, robot, folder, main)
    model, shapes = _reduced(whole, robot, choice, movers, simple_shapes(whole, robot))
    data = model.createData()
    pin.forwardKinematics(model, data, pin.neutral(model))
    capsules: list[list[Capsule]] = [[] for _ in range(model.njoints)]
    for shape in shapes.geometryObjects:
        capsules[shape.parentJoint].append(capsule_of(shape))
    links = tuple(replace(_link(model, data, i), capsules=tuple(capsules[i])) for i in range(1, model.njoints))
    frame = model.frames[model.getFrameId(tip, pin.FrameType.BODY)]
    hand = frame.placement.rotation @ choice.hand
    x, y, z = frame.placement.translation.tolist()
    names = tuple(joint_name(name) for name in model.names[1:])
    carried = _links_of(model)
    _check_inertias(model, robot, carried)
    weightless = _weightless(model, carried, (massless_links(robot) & shaped_links(robot)) - weighed, main)
    moments = {name: body.inertia for name, body in zip(model.names, model.inertias, strict=True) if not body.mass}
    without_mass = [name for name in movers if name in moments and np.any(moments[name])]
    moved = set().union(*carried[1:])
    notes = assumed(robot, movers, moved | carried[0], weighed & moved, without_mass, not weightless)
    own, rotors = {joint.get("name"): joint for joint in robot.findall("joint")}, rotor_inertias(robot)[0]
    links = tuple(
        replace(x, armature=rotors.get(name, 0.0), limits=with_all_limits(own[name], x.limits))
        for x, name in zip(links, model.names[1:], strict=True)
    )
    arm = SpatialArm(links, names, (x, y, z), _rows(hand), base=tuple(capsules[0]), names=tuple(model.names[1:]))
    return without_inertia(replace(arm, notes=notes), [names[i - 1] for i in weightless])


def _whole(robot: ET.Element) -> Any:
    """The robot as Pinocchio reads it."""
    import pinocchio as pin

    try:
        return pin.buildModelFromXML(plain_urdf(robot))
    except (ValueError, RuntimeError) as error:
        raise InputError("file", "no robot", "a URDF file that Pinocchio reads", f"reason: {error}") from None


def _reduced(whole: Any, robot: ET.Element, choice: ArmChoice, movers: list[str], shapes: Any) -> tuple[Any, Any]:
    """The robot and its shapes with all joints but the movers locked."""
    import pinocchio as pin

    at = np.zeros(whole.nv)
    for name, value in _locked(robot, choice).items():
        at[whole.idx_vs[whole.getJointId(name)]] = value
    locked = [i for i in range(1, whole.njoints) if whole.names[i] not in movers]
    posture = pin.integrate(whole, pin.neutral(whole), at)
    model, (kept,) = pin.buildReducedModel(whole, [shapes], locked, posture)
    return model, kept


def _tell_apart(robot: ET.Element) -> dict[str, str]:
    """Rename links that have the name of a joint, which Pinocchio confuses; return their new names."""
    joints = {joint.get("name", "") for joint in robot.findall("joint")}
    renamed = {name: f"{name} (link)" for name in (link.get("name", "") for link in robot.findall("link"))}
    renamed = {name: new for name, new in renamed.items() if name in joints}
    for key, place in (("name", "link"), ("link", "joint/parent"), ("link", "joint/child")):
        for element in robot.iterfind(place):
            name = element.get(key, "")
            element.set(key, renamed.get(name, name))
    return renamed


def _locked(robot: ET.Element, choice: ArmChoice) -> dict[str, float]:
    """Where joints are that do not move: those that mimic a locked one follow it."""
    locked = dict(choice.locked)
    for joint in robot.findall("joint"):
        if joint.get("name", "") in choice.locked:
            low, high = position_limits(joint)
            choice.check_locked(joint.get("name", ""), low, high, turns=joint.get("type") != "prismatic")
        mimic, name = joint.find("mimic"), joint.get("name", "")
        if mimic is not None and name not in locked and joint.get("type") in MOVABLE:
            value = choice.locked.get(mimic.get("joint", ""), 0.0)
            locked[name] = number_of(mimic, "multiplier", "1") * value + number_of(mimic, "offset")
    return locked


def _check_inertias(model: Any, robot: ET.Element, carried: list[set[str]]) -> None:
    """Refuse an arm of which no body can have the inertia that moves with a joint, by the link that makes it so."""
    for body, names in zip(model.inertias[1:], carried[1:], strict=True):
        if not body.mass or is_possible(np.linalg.eigvalsh(body.inertia)):
            continue
        for link in robot.findall("link"):
            xx, yy, zz, xy, xz, yz = (number_of(link.find("inertial/inertia"), f"i{name}") for name in MOMENTS)
            moments = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
            if link.get("name") in names and not is_possible(moments):
                given = "principal moments of {:.4g}, {:.4g} and {:.4g} kg m2".format(*moments)
                rule = "three of which none is above the sum of the others"
                raise InputError(f"link {link.get('name')}: <inertia>", given, rule, "or leave out the <inertial>")


def _links_of(model: Any) -> list[set[str]]:
    """Names of the links that each joint carries, (joints,)."""
    import pinocchio as pin

    carried: list[set[str]] = [set() for _ in range(model.njoints)]
    for frame in model.frames:
        if frame.type == pin.FrameType.BODY:
            carried[frame.parentJoint].add(frame.name)
    return carried


def _weightless(model: Any, carried: list[set[str]], without: set[str], main: set[str]) -> list[int]:
    """Return the joints of which the bodies' inertia is not known.

    `carried` names the links of each joint, (joints,), `main` those that are not fixed to others, and `without` those
    that have shapes and no mass.
    """
    found, beyond = [], 0.0
    for i in reversed(range(1, model.njoints)):
        beyond += model.inertias[i].mass
        bodies = carried[i] & without
        if beyond <= 0 or bodies & main or (bodies and model.inertias[i].mass <= 0):
            found.insert(0, i)
    return found


def _link(model: Any, data: Any, i: int) -> SpatialLink:
    """Joint i and what it moves."""
    v, q = model.idx_vs[i], model.idx_qs[i]
    body, place = model.inertias[i], model.jointPlacements[i]
    slide, turn = np.split(np.ravel(data.joints[i].S), 2)
    prismatic = bool(np.any(slide))
    bounded = model.nqs[i] == 1  # a continuous joint is a cosine and a sine
    ends = (model.lowerPositionLimit[q], model.upperPositionLimit[q]) if bounded else (-np.inf, np.inf)
    low, high = (float(x) if abs(x) <= LARGEST else math.copysign(math.inf, x) for x in ends)
    limits = JointLimits(
        position=(low, high),
        velocity=_limit(model.upperVelocityLimit[v]),
        torque=_limit(model.upperEffortLimit[v]),
    )
    own = RigidBody(body.mass, body.lever, body.inertia) if body.mass else welded([])
    return SpatialLink(
        mass=float(own.mass),
        com=tuple(own.com.tolist()),
        inertia=own.moments,
        axis=tuple((slide if prismatic else turn).tolist()),
        position=tuple(place.translation.tolist()),
        rotation=_rows(place.rotation),
        kind="prismatic" if prismatic else "revolute",
        friction=float(model.damping[v]),
        limits=limits,
    )


def _limit(given: float) -> float:
    """A limit as URDF gives it, where 0 means no limit, and so does 1e16."""
    return float(given) if 0 < given <= LARGEST else float("inf")


def _rows(rotation: np.ndarray) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(row) for row in rotation.tolist())
