"""What a benchmark has computed, kept in a folder: the same command then goes on where it was left."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import whiptool
from whiptool.whole_files import write_whole


def kept(folder: Path | None, name: str, of: Any, make: Callable[[], Any]) -> Any:
    """Return what was kept under a name and is of the same input, or make it and keep it.

    Args:
        folder: Where it is kept, created if needed; None: nothing is kept.
        name: Name of the result, from which that of its file is made.
        of: All on which the result depends; whiptool's version counts in addition. What was kept of another input
            is made again.
        make: Function without arguments that returns plain data; nothing, or a table with the key `failed`, is not
            kept, and is tried again the next time.
    """
    file = folder / f"{re.sub(r'[^a-z0-9]+', '-', name.lower())}.json" if folder else None
    digest = hashlib.sha256(repr((whiptool.__version__, of)).encode()).hexdigest()
    if file is not None and file.exists() and (there := json.loads(file.read_text()))["of"] == digest:
        return there["found"]
    made = make()
    if file is not None and made and "failed" not in made:
        file.parent.mkdir(parents=True, exist_ok=True)
        write_whole(file, json.dumps({"of": digest, "found": made}))
    return made
