"""The words of our prose that `make check` refuses."""

from __future__ import annotations

import json

import pytest

from tools.plain_english import faults, files


@pytest.mark.parametrize(
    ("name", "text", "lines"),
    [
        ("page.md", "The tip is sure\nto hit, as you told `beside`.\n", [1, 2]),
        ("page.md", "```sh\ntold x  # somebody's\n```\nSurely `a\nlest` anew\n```text\nanew\n```\n", [2, 4, 5, 7]),
        ("page.md", "```{literalinclude} a.py\n:x: y\n```\nanew\n```sh\nls  # `x` anew\n```\n", [4, 6]),
        ("module.py", '"""Of x.\n\nArgs:\n    told: None.\n    y: There is none: {told}.\n"""\nanew = "told"\n', [5]),
        ("module.py", 'x = f"of its own, {told} y"  # lest\n', [1, 1]),
        ("book.ipynb", {"cells": [{"cell_type": "code", "source": ["# anew"]},
                                  {"cell_type": "markdown", "source": ["Drawn\n", "anew"]}]}, [2]),
    ],
)  # fmt: skip
def test_words_are_found_in_prose_and_not_in_code(name, text, lines, tmp_path):
    path = tmp_path / name
    path.write_text(text if isinstance(text, str) else json.dumps(text), encoding="utf-8")
    assert [int(fault.removeprefix(f"{path}:").split(":")[0]) for fault in faults(path)] == lines


def test_pages_notebooks_and_modules_are_looked_at():
    found = {str(path) for path in files()}
    assert {"README.md", "docs/how-to/identify.md", "notebooks/05_identify.ipynb", "whiptool/goals/goals.py"} <= found
    assert "CHANGELOG.md" not in found
