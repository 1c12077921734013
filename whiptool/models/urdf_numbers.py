"""Numbers of URDF files, which are all checked before Pinocchio reads them: its parser leaves out masses, inertias and
shapes with numbers that it cannot read.
"""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterable, Iterator

from whiptool.errors import InputError
from whiptool.models.urdf_limits import number_of

MOVABLE = ("revolute", "continuous", "prismatic")  # types of joints that move along one coordinate
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?", re.ASCII)
_PLACE, _ROUND = {"xyz": 3, "rpy": 3}, {"radius": 1, "length": 1}
_SHAPES = {"box": {"size": 3}, "sphere": {"radius": 1}, "cylinder": _ROUND, "capsule": _ROUND}
_OF_LINK = {  # elements that are used, and how many numbers are in each of their attributes
    "inertial/origin": _PLACE,
    "inertial/mass": {"value": 1},
    "inertial/inertia": dict.fromkeys(("ixx", "iyy", "izz", "ixy", "ixz", "iyz"), 1),
}
for _use in ("collision", "visual"):
    _OF_LINK |= {f"{_use}/origin": _PLACE, f"{_use}/geometry/mesh": {"scale": 3}}
    _OF_LINK |= {f"{_use}/geometry/{shape}": sizes for shape, sizes in _SHAPES.items()}
_OF_JOINT = {
    "origin": _PLACE,
    "axis": {"xyz": 3},
    "limit": dict.fromkeys(("effort", "velocity", "lower", "upper", "acceleration", "deceleration", "jerk"), 1),
    "dynamics": {"damping": 1, "friction": 1},
    "mimic": {"multiplier": 1, "offset": 1},
    "safety_controller": {"soft_lower_limit": 1, "soft_upper_limit": 1},
    "position_based_velocity_limits": {"deceleration_limit": 1, "velocity_offset": 1},
}
_NEEDED = {"mass": ("value",), "inertia": tuple(_OF_LINK["inertial/inertia"]), "limit": ("effort", "velocity")}
_NEEDED |= {shape: tuple(sizes) for shape, sizes in _SHAPES.items()}
_NEVER_NEGATIVE = ("value", "radius", "length", "size", "damping", "friction")
_GEARS = {"rotor_inertia": "gear_ratio", "motorInertia": "mechanicalReduction"}  # of Drake; of others


def check_numbers(robot: ET.Element) -> None:
    """Refuse numbers that are used and missing or unreadable, and write the others as every parser reads them; refuse
    an `<inertial>` without its mass or inertia, and names that are taken."""
    for tag, places in (("link", _OF_LINK), ("joint", _OF_JOINT)):
        names: set[str] = set()
        for part in robot.findall(tag):
            label = f"{tag} {part.get('name', '')}"
            if part.get("name", "") in names:
                raise InputError(label, f"another <{tag}> of this name", "names that differ")
            names.add(part.get("name", ""))
            for inertial in part.findall("inertial"):
                for needed in ("mass", "inertia"):
                    if inertial.find(needed) is None:
                        fix = "leave out the <inertial> of a link that has no mass"
                        raise InputError(label, f"an <inertial> without <{needed}>", "<mass> and <inertia> in it", fix)
            for place, sizes in places.items():
                if tag == "link" or place == "origin" or part.get("type") in MOVABLE:
                    _check_elements(label, place, part.findall(place), sizes)


def _check_elements(label: str, place: str, elements: Iterable[ET.Element], sizes: dict[str, int]) -> None:
    for element in elements:
        for name, size in sizes.items():
            if name in element.attrib:
                values = _numbers(f"{label}: {name} of <{place}>", element.attrib[name], size, name in _NEVER_NEGATIVE)
                element.set(name, " ".join(map(repr, values)))
            elif name in _NEEDED.get(element.tag, ()):
                fix = f'{name}="0" says that there is no limit' if element.tag == "limit" else "write it into the file"
                raise InputError(f"{label}: <{place}>", f"no {name}", "a number", fix)


def _numbers(label: str, text: str, size: int = 1, never_negative: bool = False) -> list[float]:
    """The numbers of an attribute."""
    words = text.split()
    values = [float(word) for word in words if _NUMBER.fullmatch(word)]
    read = len(values) == len(words) == size and all(map(math.isfinite, values))
    if not read or (never_negative and min(values) < 0):
        rule = ("a number" if size == 1 else f"{size} numbers") + (" >= 0" if never_negative else "")
        fix = "write points and blanks, no commas" if "," in text else "correct it in the file"
        fix = "expand xacro first" if "$" in text else fix
        raise InputError(label, text, rule, fix)
    return values


def rotor_inertias(robot: ET.Element) -> tuple[dict[str, float], list[str]]:
    """Return the inertias of rotors as the joints feel them [kg m^2 or kg], times the square of the gear ratio, by the
    joints' names, and the names of transmissions that have some and move several joints. Those of one joint, in several
    places, have to be the same.
    """
    found: dict[str, float] = {}
    shared = []
    for place in [*robot.findall("joint"), *robot.findall("transmission")]:
        label, inertias = f"{place.tag} {place.get('name', '')}", []
        for rotor, gear in _motors(place):
            ratio = _numbers(f"{label}: gear ratio", gear)[0]
            inertias.append(_numbers(f"{label}: rotor inertia", rotor, 1, True)[0] * ratio**2)
        joints = [place] if place.tag == "joint" else place.findall("joint")
        if inertias and len(joints) != 1:
            shared.append(place.get("name", ""))
        elif inertias:
            name, felt = joints[0].get("name", ""), sum(inertias)
            if not math.isclose(found.setdefault(name, felt), felt, rel_tol=1e-6):
                given = f"rotor inertias of {found[name]:g} and {felt:g} kg m2, gears included"
                raise InputError(f"joint {name}", given, "the same in <joint> and <transmission>")
    return found, shared


def _motors(place: ET.Element) -> Iterator[tuple[str, str]]:
    """Inertia of each rotor and its gear ratio, as they are written in a joint or a transmission."""
    for motor in place.findall("motor"):
        if "motor_inertia" in motor.attrib:
            yield motor.attrib["motor_inertia"], motor.get("gear_ratio", "1")
    for holder in [place] if place.tag == "joint" else place.findall("actuator"):
        for name, gear in _GEARS.items():
            gears = [x.get("value", x.text or "") for within in (holder, place) for x in within.iter(gear)]
            for rotor in holder.findall(name):
                yield rotor.get("value", rotor.text or ""), (gears or ["1"])[0]


def plain_urdf(robot: ET.Element, shapes: Callable[[ET.Element], Iterable[ET.Element]] = lambda link: ()) -> str:
    """Return links, with some of their shapes, and joints of a checked robot as XML that Pinocchio reads whole."""
    plain = ET.Element("robot", name=robot.get("name") or "robot")
    for link in robot.findall("link"):
        kept = ET.SubElement(plain, "link", name=link.get("name", ""))
        kept.extend([*link.findall("inertial")[:1], *link.findall("collision_checking"), *shapes(link)])
    for joint in robot.findall("joint"):
        moves = joint.get("type") in MOVABLE
        kind = joint.get("type", "") if moves else "fixed"
        kept = ET.SubElement(plain, "joint", name=joint.get("name", ""), type=kind)
        kept.extend(x for x in joint if x.tag in ("parent", "child", "origin"))
        if not moves:
            continue
        kept.extend(joint.findall("axis"))
        kept.extend(x for x in joint.findall("dynamics") if {"damping", "friction"} & set(x.attrib))
        limit = joint.find("limit")  # Pinocchio needs one, and reads no negative ones
        ends = {x: limit.attrib[x] for x in ("lower", "upper") if limit is not None and x in limit.attrib}
        sizes = {x: repr(max(number_of(limit, x), 0.0)) for x in ("velocity", "effort")}
        ET.SubElement(kept, "limit", ends | sizes)
    return ET.tostring(plain, encoding="unicode")
