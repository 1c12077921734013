"""Every notebook runs, its longest studies with fewer strikes, calls only what is public, and is committed with what it
shows."""

from __future__ import annotations

import ast
import re
import shutil
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from human_data import DATA as PEOPLE
from processes import HANG
from repository import ROOT

if TYPE_CHECKING:  # it takes seconds, in every process that collects tests
    import nbformat

ON_PEOPLE = ("07_people_and_machines",)  # it reads the user's copy of their data
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
SMALLER = {  # studies that take tens of seconds, and what the test computes of them
    "01_first_strike": {"animate(path, model, target)": "animate(path, model, target, fps=5)"},
    "03_impedance": {"np.random.default_rng(1), 200)": "np.random.default_rng(1), 40)"},
    "04_search_and_learning": {"max_trials=200": "max_trials=100", "episodes=12": "episodes=6"},
    "06_rig_and_sim2real": {"for one in targets]": "for one in targets[:2]]", "max_strikes=4": "max_strikes=2"},
}
LONGEST_CELL = 25  # lines
LARGEST = 1.5e6  # bytes
MACHINE_PATH = re.compile(r"(/home/|/root/|/tmp/|/Users/|/usr/|/opt/|site-packages|[A-Z]:\\\\)")
NOT_INSTALLED = re.compile(r"^(from|import) (papers|tools|tests|benchmarks)\b", re.MULTILINE)
each_notebook = pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)


def code_cells(path: Path) -> list[nbformat.NotebookNode]:
    import nbformat

    return [cell for cell in nbformat.read(path, 4).cells if cell.cell_type == "code"]


def words(output: nbformat.NotebookNode) -> str:
    """What an output says in words: no embedded pictures and films."""
    data = output.get("data", {})
    said = [output.get("text", ""), data.get("text/plain", ""), data.get("text/html", "")]
    return re.sub(r"base64,[\s\w+/=\\]+", "", "".join(said))


def hidden_names(source: str) -> list[str]:
    """Names with a leading underscore that a cell imports or takes from an object; `__name__` and the like are fine."""
    code = "\n".join(line for line in source.splitlines() if not line.startswith(("%", "!")))
    names = []
    for node in ast.walk(ast.parse(code)):
        if isinstance(node, ast.Import | ast.ImportFrom):
            modules = [alias.name for alias in node.names] + [getattr(node, "module", None) or ""]
            names += [part for module in modules for part in module.split(".")]
        elif isinstance(node, ast.Attribute):
            names.append(node.attr)
    return [name for name in names if name.startswith("_") and not name.endswith("__")]


def test_there_are_notebooks():
    assert NOTEBOOKS


@pytest.mark.slow
@each_notebook
def test_it_runs(path, tmp_path, monkeypatch):
    import nbformat
    from nbclient import NotebookClient

    if path.stem in ON_PEOPLE and not PEOPLE.is_dir():
        pytest.skip(f"people's throws are not beside the repository ({PEOPLE})")
    monkeypatch.setenv("WHIP_HUMANS", str(PEOPLE))
    text = path.read_text(encoding="utf-8")
    for given, less in SMALLER.get(path.stem, {}).items():
        assert text.count(given) == 1, given
        text = text.replace(given, less)
    notebook = nbformat.reads(text, 4)
    if (data := path.parent / "data").is_dir():
        shutil.copytree(data, tmp_path / "data")
    # raises CellExecutionError with the cell's own traceback
    NotebookClient(
        notebook, timeout=int(HANG), kernel_name="python3", resources={"metadata": {"path": str(tmp_path)}}
    ).execute()
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    complaints = [o.text for o in outputs if o.get("name") == "stderr"]  # warnings, progress bars
    assert not [text for text in complaints if "font cache" not in text]  # matplotlib's, on a new machine


@each_notebook
def test_it_is_committed_as_it_ran(path):
    cells = code_cells(path)
    assert [cell.execution_count for cell in cells] == list(range(1, len(cells) + 1))
    outputs = [output for cell in cells for output in cell.outputs]
    assert any("image/png" in output.get("data", {}) for output in outputs)
    assert path.stat().st_size < LARGEST
    for output in outputs:
        assert output.output_type != "error"
        assert output.get("name") != "stderr", output.text
        assert not MACHINE_PATH.search(words(output)), words(output)


@each_notebook
def test_its_cells_are_short_and_public(path):
    for cell in code_cells(path):
        assert len(cell.source.splitlines()) <= LONGEST_CELL, cell.source
        assert not hidden_names(cell.source), cell.source
        assert not NOT_INSTALLED.search(cell.source), cell.source


def test_hidden_names_are_found():
    assert hidden_names("from whiptool.viz.plots import _at") == ["_at"]
    assert hidden_names("import whiptool._a.b") == ["_a"]
    assert hidden_names("%matplotlib inline\nx = rollout._engine()") == ["_engine"]
    assert not hidden_names("from whiptool import plots\nprint(plots.__doc__, [1 for _ in range(3)])")
