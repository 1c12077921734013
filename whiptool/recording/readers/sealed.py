"""Parsers in C that crash or never end on damaged bytes, run in a separate process with bounds on time and memory.

SciPy's reader of MAT files and ezc3d do: of a few hundred randomly damaged files each, some end in a segmentation fault
or a loop.
"""

from __future__ import annotations

import io
import json
import os
import subprocess
import sys
from importlib import import_module
from pathlib import Path
from typing import NoReturn

import numpy as np

from whiptool.errors import InputError
from whiptool.given_files import parsing

SECONDS, MEMORY = 30, 4 << 30  # of the child: processor time, and address space in bytes
REFUSED, FAILED = 3, 4  # its exit status after an InputError, and after any other error


def unpack(path: Path, kind: str) -> dict[str, np.ndarray]:
    """Parse a file of format `mat` or `c3d` in a separate process, and return its arrays of numbers and texts by name.

    Raises:
        InputError: The file is damaged, has content that is not allowed, or takes too long or too much memory.
    """
    code = f"import sys; sys.path[:] = {sys.path!r}; import {__name__} as sealed; sealed.main()"
    command = [sys.executable, "-c", code, kind, str(path)]
    threads = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}  # each would take of the address space
    try:
        done = subprocess.run(
            command, capture_output=True, stdin=subprocess.DEVNULL, timeout=4 * SECONDS, env={**os.environ, **threads}
        )
    except subprocess.TimeoutExpired:
        raise InputError(str(path), "a file that its parser does not get through", f"a whole {kind} file") from None
    said = done.stderr.decode("utf-8", "replace").strip().splitlines()
    if done.returncode == REFUSED and said:
        raise InputError(*json.loads(said[-1])).within(f"{path}: ")
    if done.returncode:
        crashed = "crashes" if done.returncode < 0 else (said or ["nothing"])[-1][:160]
        raise InputError(str(path), "a damaged or different file", f"a whole {kind} file", f"its parser says {crashed}")
    with parsing(path, kind), np.load(io.BytesIO(done.stdout), allow_pickle=False) as data:
        return {name: data[name] for name in data.files}


def main() -> NoReturn:
    """Entry point of the separate process: parse the file in the arguments, and write its arrays to stdout as NPZ."""
    import resource

    kind, path = sys.argv[1:]
    parse = import_module(f"{__package__}.{kind}").parse  # that module imports this one
    resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS))
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    buffer = io.BytesIO()
    try:
        np.savez(buffer, allow_pickle=False, **parse(path))
    except InputError as error:
        given = error.given if isinstance(error.given, (int, float, str, type(None))) else str(error.given)
        print(json.dumps([error.name, given, error.allowed, error.fix]), file=sys.stderr)
        sys.exit(REFUSED)
    except Exception as error:  # whatever a parser throws at damaged bytes
        print(f"{type(error).__name__}: {error}".replace("\n", " "), file=sys.stderr)
        sys.exit(FAILED)
    sys.stdout.buffer.write(buffer.getvalue())
    sys.stdout.flush()
    os._exit(0)  # what a parser left behind may crash on the way out
