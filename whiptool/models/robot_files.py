"""Functions for URDF and MJCF files: checks before parsing, and the choice of the serial chain that is the arm.

The parsers of Pinocchio and MuJoCo are recursive and crash Python at thousands of nested elements; MuJoCo opens every
included file, and creates any number of bodies.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from whiptool.errors import InputError
from whiptool.given_files import read_text, whole_file
from whiptool.models.numbers import ASK_UNIT, LONGEST, number, numbers
from whiptool.models.strike import FARTHEST_TURN

_DEEPEST = 200  # elements within elements
_MOST = 20_000  # elements, with those that MuJoCo makes of one
_FILES = 100  # that are included
_LARGEST = 20_000_000  # numbers that MuJoCo makes of attributes: of height fields, pictures, meshes and `user` data
_LONGEST = 99_999  # pixels of one side
_SIZES = {"hfield": ("nrow", "ncol"), "texture": ("width", "height"), "mesh": ("params", "params")}  # their product
_WEIGHTS = {"mesh": 20, "flexcomp": 10_000}  # numbers that MuJoCo makes of one vertex
_TAG = re.compile(r"""<(/?)([A-Za-z_][\w:.-]*)((?:[^<>"']|"[^"]*"|'[^']*')*?)(/?)>""")
_PASSED_OVER = re.compile(r"<!--.*?(?:-->|\Z)|<!\[CDATA\[.*?(?:\]\]>|\Z)", re.DOTALL)
_FOLDER = re.compile(r"""\b(?:meshdir|texturedir|assetdir)\s*=\s*["']([^"'<>]*)["']""")  # where files are looked for
_MAKING = ("replicate", "composite", "flexcomp")  # of MuJoCo, each with a `count`


def read_urdf_text(path: Path | str) -> str:
    """Return the text of a URDF file that is not nested too deeply, not too large, and defines no XML entities."""
    text = read_text(path, "URDF")
    _check(Path(path), text, Counter())
    return text


def check_mjcf(path: Path | str) -> None:
    """Refuse an MJCF file, or one that it includes, that is not safe to parse or of which MuJoCo makes too much."""
    _check(Path(path), read_text(path, "MJCF"), Counter())


def _check(path: Path, text: str, tally: Counter[str], times: int = 1) -> None:
    """Refuse what is unsafe, and count into a tally what MuJoCo makes of elements that are there so many times."""
    if "<!ENTITY" in text:
        raise InputError("file", str(path), "XML that defines no entities")
    folders = ["", *_FOLDER.findall(text)]
    copies = [times]  # of what is within, for each element that is open
    for closing, name, attributes, closed in _TAG.findall(_PASSED_OVER.sub("", text)):
        if closing:
            copies = copies[:-1] or [times]
            continue
        made = copies[-1] * (_count(attributes) if name in _MAKING else 1)
        tally["elements"] += made
        if name == "attach":
            if not tally["of a model"]:
                raise InputError("file", str(path), "XML with each <model> before the <attach> that needs it")
            tally["elements"] += made * tally["of a model"]
        tally["numbers"] += made * _numbers(name, attributes)
        tally["user"] = max(tally["user"], len(_value(attributes, "user").split()))
        if name in ("include", "model") and _value(attributes, "file"):
            _check_included(path, name, attributes, tally, made)
        elif file := _value(attributes, "file"):
            for folder in folders:
                if (path.parent / folder / file).exists():
                    whole_file(path.parent / folder / file, f"file of <{name}>")
        if tally["elements"] > _MOST:
            raise InputError("file", str(path), f"XML of at most {_MOST} elements, including replicas")
        if max(tally["numbers"], tally["user"] * tally["elements"]) > _LARGEST:
            rule = (
                f"height fields, pictures, meshes, flexes and user data of at most {_LARGEST} numbers in all ({path})"
            )
            given = " ".join([name, *re.findall(r"[^\s=\"']+", attributes)])
            raise InputError("file", given, rule, "remove it, or make it smaller")
        if not closed:
            copies.append(made)
        if len(copies) > _DEEPEST:
            raise InputError("file", str(path), f"XML of at most {_DEEPEST} nested elements")


def _count(attributes: str) -> int:
    """How many an element makes: the product of the numbers of its `count`."""
    return math.prod(int(x) for x in re.findall(r"\d{1,9}", _value(attributes, "count"))) or 1


def _numbers(name: str, attributes: str) -> int:
    """How many numbers MuJoCo makes of an element, about; where one side is not given, it is as long as the other."""
    given = [re.findall(r"\d{1,9}", _value(attributes, side)) for side in _SIZES.get(name, ())]
    sides = [max(map(int, numbers)) for numbers in given if numbers]
    made = math.prod(sides) ** (1 + (len(sides) == 1)) if sides else 0
    made += (max(sides, default=0) > _LONGEST) * _LARGEST
    return _WEIGHTS.get(name, 1) * (_count(attributes) if name == "flexcomp" else made)


def _check_included(path: Path, name: str, attributes: str, tally: Counter[str], made: int) -> None:
    """Check an included file, or a model that is attached elsewhere, which counts once more at each `<attach>`."""
    file = path.parent / _value(attributes, "file")
    tally["files"] += 1
    if tally["files"] > _FILES:
        raise InputError("file", str(path), f"at most {_FILES} included files")
    if file.exists():  # MuJoCo says which is not there
        before = tally["elements"]
        _check(file, read_text(file, "MJCF"), tally, made)
        if name == "model":
            tally["of a model"] = max(tally["of a model"], tally["elements"] - before)


def _value(attributes: str, name: str) -> str:
    found = re.search(rf"""\b{name}\s*=\s*(?:"([^"]*)"|'([^']*)')""", attributes)
    return "" if found is None else found[1] or found[2] or ""


_ROUNDED = 1e-4  # by which a limit may be rounded in the file
_TOOL_FRAMES = ("tool0", "_tcp")  # what the names of tool frames end with


@dataclass(frozen=True)
class ArmChoice:
    """Selection of an arm from a robot: the chain from its base to a tip.

    `never_touch` has pairs of joint names (or `base` and a joint) whose links are not checked for contact; None: the
    pairs that touch with all joints at 0.
    """

    tip: str = ""  # name of the link, body or site at which the hand is; empty: the only link that carries no other
    moving: tuple[str, ...] | None = None  # names of the joints that move; None: all of the chain not in `locked`
    locked: Mapping[str, float] = field(default_factory=dict)  # positions of joints that do not move [rad or m]; else 0
    outward: tuple[float, ...] = (0.0, 0.0, 1.0)  # direction of stick or whip in the tip's frame; z as for flanges
    never_touch: Sequence[tuple[str, str]] | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.tip, str):
            raise InputError("tip", self.tip, "the name of a link, body or site")
        if self.moving is not None:
            if isinstance(self.moving, str) or not all(isinstance(name, str) for name in self.moving):
                raise InputError("moving", self.moving, "a list of joints' names")
            object.__setattr__(self, "moving", tuple(self.moving))
        if not isinstance(self.locked, Mapping):
            raise InputError("locked", self.locked, "positions of joints in rad or m by the joints' names")
        locked = {name: number(f"locked.{name}", value) for name, value in self.locked.items()}
        object.__setattr__(self, "locked", locked)
        for name in self.moving or ():
            if name in locked:
                raise InputError("locked", name, "joints that do not move", "this joint is among those that move")
        outward = np.array(numbers("outward", self.outward, 3))
        if not outward.any():
            raise InputError("outward", self.outward, "a direction, which is not 0 0 0")
        object.__setattr__(self, "outward", tuple((outward / np.linalg.norm(outward)).tolist()))

    def check_locked(self, name: str, low: float, high: float, *, turns: bool) -> None:
        """Refuse a locked joint's position beyond its limits [rad or m], such as one in degrees or millimetres; the
        angle of a joint that `turns` has to be within two turns in any case."""
        value, unit = self.locked[name], "rad" if turns else "m"
        farthest = FARTHEST_TURN if turns else LONGEST
        low, high = max(low, -farthest), min(high, farthest)
        if not low - _ROUNDED <= value <= high + _ROUNDED:
            fix = "angles are in radians; are these degrees?" if turns else ASK_UNIT
            raise InputError(
                f"locked.{name}", value, f"from {low:g} to {high:g} {unit}, within the joint's limits", fix
            )

    def movers(self, chain: Sequence[str], joints: Sequence[str]) -> list[str]:
        """Return the names of the joints that move: those of the chain that are neither locked nor left out. What moves
        has to be in the chain, and what is locked among all `joints` of the robot."""
        for option, names, known in (("moving", self.moving or (), chain), ("locked", self.locked, joints)):
            for name in names:
                if name not in known:
                    raise InputError(option, name, "one of the joints " + ", ".join(known))
        taken = chain if self.moving is None else self.moving
        movers = [name for name in chain if name in taken and name not in self.locked]
        if not movers:
            fix = "" if chain else "no joint between base and tip moves: choose another tip, or the file of a robot"
            raise InputError("moving", movers, "one or more of the joints " + (", ".join(chain) or "(none)"), fix)
        return movers

    def only_tip(self, ends: Sequence[str], frames: Sequence[str]) -> str:
        """Return the name of the tip, one of the `frames`.

        If no tip is named and several links are `ends`, which carry no other, it is the one that is named like a tool
        frame: `tool0`, the flange's frame by the ROS-Industrial convention (REP 199), or `..._tcp`.
        """
        if self.tip:
            if self.tip not in frames:
                raise InputError("tip", self.tip, "one of " + ", ".join(frames))
            return self.tip
        if not ends:
            raise InputError("bodies", "none", "a robot, whose bodies hang on joints", "choose another file")
        tools = [name for name in ends if name.endswith(_TOOL_FRAMES)]
        found = ends if len(ends) == 1 else tools
        if len(found) != 1:
            raise InputError(
                "tip",
                "none",
                "the name of one end, as the robot branches: " + ", ".join(ends),
                "give --arm-tip NAME, arm.tip in a model file, or tip=NAME in Python",
            )
        return found[0]

    @property
    def hand(self) -> np.ndarray:
        """Rotation of the hand's frame in the frame of the link `tip`, (3, 3): the hand's -z axis, along which a stick
        or the hanging whip points, is `outward`."""
        z = -np.array(self.outward)
        across = np.eye(3)[np.abs(z).argmin()]  # the first of the axes that are most across
        x = across - (across @ z) * z
        x /= np.linalg.norm(x)
        return np.column_stack([x, np.cross(z, x), z])
