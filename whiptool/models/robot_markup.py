"""Robots' files before their parsers see them: of bounded size and depth, without entities, with what they include.

The parsers of Pinocchio and MuJoCo go through elements within elements by recursion, which ends Python where there are
thousands of levels; MuJoCo opens whatever a file includes, and makes as many bodies as the file asks for.
"""

from __future__ import annotations

import math
import re
from pathlib import Path

from whiptool.errors import InputError
from whiptool.given_files import read_text, whole_file

_DEEPEST = 200  # elements within elements
_MOST = 20_000  # elements, with those that MuJoCo makes of one
_FILES = 100  # that are included
_TAG = re.compile(r"""<(/?)([A-Za-z_][\w:.-]*)((?:[^<>"']|"[^"]*"|'[^']*')*?)(/?)>""")
_PASSED_OVER = re.compile(r"<!--.*?(?:-->|\Z)|<!\[CDATA\[.*?(?:\]\]>|\Z)", re.DOTALL)
_FOLDER = re.compile(r"""\b(?:meshdir|texturedir|assetdir)\s*=\s*["']([^"'<>]*)["']""")  # where files are looked for
_MAKING = ("replicate", "composite", "flexcomp")  # of MuJoCo, each with a `count`
_PIXELS = ("width", "height", "nrow", "ncol")


def read_urdf_text(path: Path | str) -> str:
    """Return the text of a URDF file after checking it.

    Raises:
        InputError: The file cannot be read, is nested too deeply, is too large, or defines XML entities.
    """
    text = read_text(path, "URDF")
    _check(Path(path), text, [])
    return text


def check_mjcf(path: Path | str) -> None:
    """Refuse an MJCF file that is not safe to parse.

    Raises:
        InputError: As in `read_urdf_text`, for the file or one that it includes.
    """
    _check(Path(path), read_text(path, "MJCF"), [])


def _check(path: Path, text: str, included: list[Path]) -> None:
    if "<!ENTITY" in text:
        raise InputError("file", str(path), "XML that defines no entities")
    folders = ["", *_FOLDER.findall(text)]
    copies, elements = [1], 0  # of what is within, for each element that is open
    for closing, name, attributes, closed in _TAG.findall(_PASSED_OVER.sub("", text)):
        if closing:
            copies = copies[:-1] or [1]
            continue
        made = copies[-1] * (_count(attributes) if name in _MAKING else 1)
        elements += made
        if elements > _MOST:
            raise InputError("file", str(path), f"XML of at most {_MOST} elements, replicas counted")
        _check_pixels(path, attributes)
        if name == "include":
            _check_included(path, attributes, included)
        elif file := _value(attributes, "file"):
            for folder in folders:
                if (path.parent / folder / file).exists():
                    whole_file(path.parent / folder / file, f"file of <{name}>")
        if not closed:
            copies.append(made)
        if len(copies) > _DEEPEST:
            raise InputError("file", str(path), f"XML of at most {_DEEPEST} elements within elements")


def _count(attributes: str) -> int:
    """How many an element makes: the product of the numbers of its `count`."""
    return math.prod(int(x) for x in re.findall(r"\d{1,9}", _value(attributes, "count"))) or 1


def _check_pixels(path: Path, attributes: str) -> None:
    for name in _PIXELS:
        if re.fullmatch(r"\d{6,}", value := _value(attributes, name)):
            raise InputError("file", f"{name} {value[:20]}", f"pictures and height fields below 100000 ({path})")


def _check_included(path: Path, attributes: str, included: list[Path]) -> None:
    file = path.parent / _value(attributes, "file")
    included.append(file)
    if len(included) > _FILES:
        raise InputError("file", str(path), f"at most {_FILES} included files")
    if file.exists():  # MuJoCo says which is not there
        _check(file, read_text(file, "MJCF"), included)


def _value(attributes: str, name: str) -> str:
    found = re.search(rf"""\b{name}\s*=\s*(?:"([^"]*)"|'([^']*)')""", attributes)
    return "" if found is None else found[1] or found[2] or ""
