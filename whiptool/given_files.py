"""Reading of files from outside: only regular files of plausible size; damage is reported in one line.

Nothing is unpickled. Pipes and devices are refused, because opening or reading them may never end.
"""

from __future__ import annotations

import codecs
import dataclasses
import hashlib
import io
import json
import math
import os
import re
import stat
import subprocess
import sys
import tomllib
import zipfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any, NoReturn, get_type_hints

import numpy as np
from numpy.lib import format as npy
from typeguard import CollectionCheckStrategy, TypeCheckError, check_type

from whiptool.errors import InputError, WhiptoolError

LARGEST = 2**31  # [bytes] of a file, and of what an NPZ file holds; video, which is streamed, may be larger
LARGEST_TEXT = 2**26  # [bytes] of a file that is read as text
PARSER_TIME, PARSER_MEMORY = 30, 4 << 30  # of a separate process: processor time [s], and address space [bytes]
_REFUSED, _FAILED = 3, 4  # its exit status after an InputError, and after any other error
_SIZES = npy.read_array_header_1_0, npy.read_array_header_2_0  # readers of an array's shape and type, by version


def whole_file(path: Path | str, name: str = "recording", *, largest: float = LARGEST) -> Path:
    """Return the path of a file after checking that it is a readable regular file and not empty.

    Args:
        path: The file.
        name: Name in error messages.
        largest: Largest allowed size [bytes].

    Raises:
        InputError: The file does not exist, is a folder, a pipe or a device, is empty or too large, or cannot be
            opened.
    """
    size = _size(path := Path(path), name, "file")
    if size == 0:
        raise InputError(str(path), "an empty file", f"a {name}")
    if size > largest:
        fix = "keep only the part with the strike" if name == "recording" else ""
        raise InputError(str(path), f"{size} bytes", f"at most {largest:.0f} bytes", fix)
    return path


def _size(path: Path, name: str, kind: str) -> int:
    """Size of a regular file that can be opened [bytes]."""
    try:
        mode = path.stat().st_mode
        if stat.S_ISDIR(mode):
            raise InputError(name, str(path), f"a readable {kind}, not a folder")
        if not stat.S_ISREG(mode):
            raise InputError(name, str(path), f"a readable {kind}, which is not a pipe or a device")
        with path.open("rb"):
            return path.stat().st_size
    except (OSError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        reason = getattr(error, "strerror", None) or error  # ValueError: a name with a NUL byte
        raise InputError(name, str(path), f"a readable {kind}", f"reason: {reason}") from None


def read_bytes(path: Path, name: str, *, kind: str = "file", largest: int = LARGEST_TEXT) -> bytes:
    """Return the content of a regular file, which may be empty.

    Args:
        path: The file.
        name, kind: Name and kind of file in error messages.
        largest: Largest allowed size [bytes].

    Raises:
        InputError: The file is not a regular file, cannot be read or is too large.
    """
    if (size := _size(path, name, kind)) > largest:
        raise InputError(str(path), f"{size} bytes", f"a {kind} of at most {largest} bytes")
    return path.read_bytes()


def read_text(path: Path | str, kind: str, name: str = "file") -> str:
    """Return the content of a text file in UTF-8, or in UTF-16 with a byte order mark.

    Args:
        path: The file.
        kind: Kind of file, such as `TOML`.
        name: Name in error messages.

    Raises:
        InputError: The file is not a regular file, cannot be read, is too large, or is not UTF-8.
    """
    content = read_bytes(Path(path), name, kind=f"{kind} file")
    try:
        return io.TextIOWrapper(io.BytesIO(content), encoding=encoding_of(content[:2])).read()
    except UnicodeError as error:
        raise InputError(name, str(path), f"valid {kind}, which is text", f"reason: {error}") from None


def encoding_of(head: bytes) -> str:
    """Return the encoding of a text by its first bytes: UTF-16 if they are its byte order mark, else UTF-8."""
    return "utf-16" if head[:2] in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE) else "utf-8-sig"


def number_in(text: str) -> float:
    """Return the number that a text states; `float` would also take `1_0.5` and digits of other scripts.

    Raises:
        ValueError: The text states none.
    """
    if "_" in text or not text.strip().isascii():
        raise ValueError(f"{text[:40]!r} does not state a number")
    return float(text)


def read_json(path: Path | str) -> dict[str, Any]:
    """Return the content of a JSON file, which is a table.

    Raises:
        InputError: The file cannot be read, is not JSON, or has another content.
    """
    try:
        content = json.loads(read_text(path, "JSON"), parse_constant=_no_number)
    except (ValueError, RecursionError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError("file", str(path), "valid JSON", f"reason: {str(error)[:120]}") from None
    if not isinstance(content, dict):
        raise InputError(str(path), type(content).__name__, "JSON that holds a dict")
    return content


def _no_number(word: str) -> NoReturn:
    raise ValueError(f"{word} does not count as a number in JSON")


def check_kinds(cls: type, table: Mapping[str, Any], place: str = "") -> None:
    """Refuse values in a table of a dataclass's fields that are of other kinds than the fields; lists are tuples there.

    Raises:
        InputError: A value is of another kind; it is named, preceded by `place`.
    """
    kinds = get_type_hints(cls)
    for name in table.keys() & kinds.keys():
        try:
            check_type(table[name], kinds[name], collection_check_strategy=CollectionCheckStrategy.ALL_ITEMS)
            np.asarray(table[name] if kinds[name] is float else 0.0, float)  # no integer of hundreds of digits
        except (TypeCheckError, OverflowError):
            kind = getattr(kinds[name], "__name__", str(kinds[name]))
            raise InputError(place + name, table[name], f"a value of the kind {kind}") from None


def read_arrays(path: Path | str, name: str, shapes: Mapping[str, str] | None = None) -> dict[str, np.ndarray]:
    """Return the arrays of an NPZ file by name, without loading pickled objects.

    Args:
        path: The file.
        name: Name in error messages, such as `recording`.
        shapes: Required numeric arrays by name, with one letter for each axis; axes with the same letter have equal
            lengths. None: any arrays.

    Raises:
        InputError: The file cannot be read, is damaged, holds pickled objects or more than `LARGEST` bytes, or a
            required array is missing, not numeric or of another shape.
    """
    path = whole_file(path, name)
    with parsing(path, "NPZ"):
        with zipfile.ZipFile(path) as archive:
            size = sum(member.file_size for member in archive.infolist())
            if size > LARGEST:
                raise InputError("size", f"{size} bytes unpacked", f"at most {LARGEST} bytes")
            arrays = {x.filename.removesuffix(".npy"): _array(archive, x) for x in archive.infolist()}
        _check_shapes(arrays, shapes or {})
        return arrays


def _array(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> np.ndarray:
    """An array, which may not say that it is larger than what there is of it."""
    with archive.open(member) as file:
        shape, dtype = _announced(file)
    if dtype.hasobject:
        raise InputError(member.filename, "pickled objects", "numbers or texts", "pickled objects are never read")
    if math.prod(shape) * dtype.itemsize > member.file_size:
        raise InputError(member.filename, f"the shape {shape}", f"what {member.file_size} bytes can hold")
    with archive.open(member) as file:
        return npy.read_array(file, allow_pickle=False)


def _announced(file: IO[bytes]) -> tuple[tuple[int, ...], np.dtype]:
    """Shape and type of an array, as the beginning of its file has them."""
    major, _ = npy.read_magic(file)
    if not 1 <= major <= len(_SIZES):
        raise InputError("version", major, f"an array's format from 1 to {len(_SIZES)}")
    shape, _, dtype = _SIZES[major - 1](file)
    return shape, dtype


def _check_shapes(arrays: Mapping[str, np.ndarray], shapes: Mapping[str, str]) -> None:
    lengths: dict[str, int] = {}
    for key, axes in shapes.items():
        array = arrays.get(key)
        if array is None:
            raise InputError("key", ", ".join(arrays)[:80], "the keys " + ", ".join(shapes), f"{key} is not there")
        if array.dtype.kind not in "biuf" or array.ndim != len(axes):
            given = f"{array.dtype} of shape {array.shape}"
            raise InputError(key, given, f"numbers of shape ({', '.join(axes)})")
        for axis, length in zip(axes, array.shape, strict=True):
            if lengths.setdefault(axis, length) != length:
                raise InputError(key, array.shape, f"({', '.join(axes)}), {axis} being {lengths[axis]}")


@contextmanager
def parsing(path: Path, kind: str) -> Iterator[None]:
    """Turn any exception that a parser raises for a damaged file into an InputError that names the file.

    Raises:
        InputError: The block raised an exception that is not whiptool's own. To an InputError of whiptool the file's
            name is added.
    """
    try:
        yield
    except InputError as error:
        named = str(path.with_suffix("")) in error.name  # or its sidecar is
        raise (error if named else error.within(f"{path}: ")) from None
    except WhiptoolError:
        raise
    except Exception as error:  # parsers document few of the errors that they raise: on damage all mean the same
        reason = f"{type(error).__name__}: {error}".replace("\n", " ")[:160]
        raise InputError(
            str(path), "a damaged or different file", f"a whole {kind} file", f"its parser says {reason}"
        ) from None


def without_number(path: Path) -> tuple[Path, int | None]:
    """Return the file or folder of `PATH#3`, and the number; of a path that exists itself, and None."""
    found = None if path.exists() else re.fullmatch(r"(.+)#(\d+)", path.name)
    return (path.with_name(found[1]), int(found[2])) if found else (path, None)


def parsed_apart(path: Path, kind: str, parse: Callable[[str], Mapping[str, np.ndarray]]) -> dict[str, np.ndarray]:
    """Parse a file in a separate process with bounds on time and memory, and return its arrays by name.

    Parsers in C crash or never end on damaged bytes: of a few hundred randomly damaged files each, SciPy's reader of
    MAT files and ezc3d end in some segmentation faults and some loops.

    Args:
        path: The file.
        kind: Kind of file, for messages.
        parse: Function of a module that returns arrays of numbers and texts for the path of a file.

    Raises:
        InputError: The file is damaged, has content that is not allowed, or takes too long or too much memory.
    """
    imports = f"from {__name__} import write_parsed; from {parse.__module__} import {parse.__name__} as parse"
    code = f"import sys; sys.path[:] = {sys.path!r}; {imports}; write_parsed(parse)"
    command = [sys.executable, "-c", code, str(path)]
    threads = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}  # each would take of the address space
    try:
        done = subprocess.run(
            command,
            capture_output=True,
            stdin=subprocess.DEVNULL,
            timeout=4 * PARSER_TIME,
            env={**os.environ, **threads},
        )
    except subprocess.TimeoutExpired:
        raise InputError(str(path), "a file that its parser does not get through", f"a whole {kind} file") from None
    said = done.stderr.decode("utf-8", "replace").strip().splitlines()
    if done.returncode == _REFUSED and said:
        raise InputError(*json.loads(said[-1])).within(f"{path}: ")
    if done.returncode:
        crashed = "crashes" if done.returncode < 0 else (said or ["nothing"])[-1][:160]
        raise InputError(str(path), "a damaged or different file", f"a whole {kind} file", f"its parser says {crashed}")
    with parsing(path, kind), np.load(io.BytesIO(done.stdout), allow_pickle=False) as data:
        return {name: data[name] for name in data.files}


def write_parsed(parse: Callable[[str], Mapping[str, np.ndarray]]) -> NoReturn:
    """In the separate process: parse the file in the arguments, and write its arrays to stdout as NPZ."""
    import resource

    resource.setrlimit(resource.RLIMIT_CPU, (PARSER_TIME, PARSER_TIME))
    resource.setrlimit(resource.RLIMIT_AS, (PARSER_MEMORY, PARSER_MEMORY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    buffer = io.BytesIO()
    try:
        np.savez(buffer, allow_pickle=False, **parse(sys.argv[1]))
    except InputError as error:
        given = error.given if isinstance(error.given, (int, float, str, type(None))) else str(error.given)
        print(json.dumps([error.name, given, error.allowed, error.fix]), file=sys.stderr)
        sys.exit(_REFUSED)
    except Exception as error:  # whatever a parser throws at damaged bytes
        print(f"{type(error).__name__}: {error}".replace("\n", " "), file=sys.stderr)
        sys.exit(_FAILED)
    sys.stdout.buffer.write(buffer.getvalue())
    sys.stdout.flush()
    os._exit(0)  # what a parser left behind may crash on the way out


def sha256(paths: Path | Iterable[Path]) -> str:
    """Return the SHA-256 checksum of a file, or of several concatenated, as hexadecimal digits.

    Raises:
        InputError: A file cannot be read.
    """
    digest = hashlib.sha256()
    for path in [paths] if isinstance(paths, Path) else paths:
        try:
            with path.open("rb") as file:
                while block := file.read(1 << 20):
                    digest.update(block)
        except OSError as error:
            raise InputError("recording", str(path), "a file that can be read", f"reason: {error.strerror}") from None
    return digest.hexdigest()


_DEEPEST = 50  # tables in tables
_PART = r"""(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+"""
_LONG_KEY = re.compile(rf"(?<![\w-])(?:{_PART}\.[ \t]*+){{{_DEEPEST}}}")  # tomllib takes the square of their number


def build_from(cls: type, table: object, place: str, **ready):
    """Return `cls(**table, **ready)` for a dataclass `cls` and a table of its fields.

    Raises:
        InputError: A key is unknown or missing, or a value is not allowed; the message names it, preceded by `place`.
    """
    if not isinstance(table, Mapping):
        raise InputError(place.rstrip("."), table, "a table")
    names = {f.name: f for f in dataclasses.fields(cls)}
    for key in table:
        if key not in names:
            raise InputError(place + key, table[key], "one of the keys " + ", ".join(names))
    for name, f in names.items():
        required = f.default is dataclasses.MISSING and f.default_factory is dataclasses.MISSING
        if required and name not in table and name not in ready:
            raise InputError(place + name, None, f"a value; the key is missing, all keys are {', '.join(names)}")
    try:
        return cls(**{**table, **ready})
    except InputError as error:
        raise error.within(place) from None


def read_toml(path: Path | str) -> dict:
    """Return the content of a TOML file as nested mappings.

    Raises:
        InputError: The file cannot be read, or is not TOML.
    """
    text = read_text(path, "TOML")
    if _LONG_KEY.search(text):
        raise InputError("file", str(path), f"TOML whose keys have at most {_DEEPEST} parts")
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise InputError("file", str(path), "TOML that is not nested as deeply") from None
    except ValueError as error:  # also of integers with thousands of digits
        raise InputError("file", str(path), "valid TOML", f"reason: {str(error)[:120]}") from None
