"""Names of an arm's joints, and what stands for them in the names of a strike's numbers."""

from __future__ import annotations

import re

from whiptool.errors import InputError

_USUAL = {1: ("shoulder",), 2: ("shoulder", "elbow")}
_ALLOWED = re.compile(r"(?!whip|target|tip|grip|world|com|end)[A-Za-z]\w*")


def checked_joints(given: object, count: int) -> tuple[str, ...]:
    """Return the given names of `count` joints; if none are given, shoulder and elbow, or joint1, joint2, ...

    Raises:
        InputError: They are not `count` different names, or one is reserved.
    """
    rule = f"{count} different names, one per link, of letters and digits; whip..., tip, target are taken"
    if not isinstance(given, (list, tuple)):
        raise InputError("joints", given, rule)
    joints = tuple(given) or _USUAL.get(count) or tuple(f"joint{i + 1}" for i in range(count))
    named = all(isinstance(joint, str) and _ALLOWED.fullmatch(joint) for joint in joints)
    if not named or len(joints) != count or len(set(joints)) != count:
        raise InputError("joints", given, rule)
    return joints


def joint_name(given: str) -> str:
    """Convert a name to one that `checked_joints` allows: letters, digits and underscores."""
    name = re.sub(r"\W", "_", given, flags=re.ASCII)
    return name if _ALLOWED.fullmatch(name) else f"joint_{name}"


def subscripts(joints: tuple[str, ...]) -> tuple[str, ...]:
    """Return the subscript of each joint in the names of a strike's coordinates, such as `s` and `e` in q_si, q_ei.

    They are the joints' initials if these differ; 1, 2, ... for joint1, joint2, ...; otherwise the whole names.
    """
    counted = tuple(str(i + 1) for i in range(len(joints)))
    if joints == tuple(f"joint{i}" for i in counted):
        return counted
    initials = tuple(joint[0] for joint in joints)
    return initials if len(set(initials)) == len(joints) else joints
