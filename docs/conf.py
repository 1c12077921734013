"""Sphinx configuration: `python -m sphinx -W --keep-going -b html docs docs/_build/html`."""

from __future__ import annotations

import pkgutil
import re
import sys
from importlib.util import find_spec
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))

from sphinx.domains.python import PythonDomain  # noqa: E402

import whiptool  # noqa: E402

project = "whiptool"
author = "The whiptool developers"
project_copyright = "The whiptool developers, MIT licence"
release = version = whiptool.__version__

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.mathjax",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
]
exclude_patterns = ["_build"]
myst_enable_extensions = ["amsmath", "deflist", "dollarmath"]
myst_heading_anchors = 3
nb_execution_mode = "off"  # the tests execute the notebooks; here they come with their outputs

autodoc_default_options = {"members": True, "ignore-module-all": True}
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
autodoc_use_type_comments = False  # the code has no such comments, and the search for them parses every function
# of the extra `oracle`, which a base class comes from
autodoc_mock_imports = [name for name in ("elastica", "numba") if find_spec(name) is None]
autodoc_typehints = "signature"
napoleon_numpy_docstring = False
napoleon_preprocess_types = False
python_maximum_signature_line_length = 100

html_theme = "pydata_sphinx_theme"
html_title = f"whiptool {release}"
html_theme_options = {"navigation_with_keys": False, "show_toc_level": 2}
html_sidebars = {"*": []}  # only pages in folders have others next to them


def take_notebooks() -> None:
    """Copy the notebooks that exist into the folder `notebooks`, with a page that lists them."""
    source, folder = HERE.parent / "notebooks", HERE / "notebooks"
    folder.mkdir(exist_ok=True)
    found = sorted(source.glob("[0-9]*.ipynb")) if source.is_dir() else []
    for old in folder.glob("*.ipynb"):
        if old.name not in {path.name for path in found}:
            old.unlink()
    for path in found:
        _write(folder / path.name, path.read_text(encoding="utf-8"))
    lines = ["# Notebooks", ""]
    if found:
        lines += ["Each runs from its first cell to its last; the tests execute them.", "", "```{toctree}"]
        lines += [":maxdepth: 1", "", *(path.stem for path in found), "```"]
    else:
        lines += ["This build was made without the folder `notebooks`."]
    _write(folder / "index.md", "\n".join(lines) + "\n")


def list_modules() -> None:
    """One page per package in the folder `api`, with all its modules; their docstrings are the reference."""
    folder = HERE / "api"
    folder.mkdir(exist_ok=True)
    pages = {"whiptool": ["whiptool"]}
    for module in pkgutil.walk_packages(whiptool.__path__, "whiptool."):
        package = ".".join(module.name.split(".")[:2])
        at_top = package == module.name and not module.ispkg
        if not module.name.endswith("__main__"):  # these are only run
            pages.setdefault("whiptool" if at_top else package, []).append(module.name)
    for old in folder.glob("*.md"):
        if old.stem not in pages:
            old.unlink()
    for package, names in pages.items():
        lines = [f"# {package}", ""]
        for name in names:
            heading = [] if name == package else [f"## {name}", ""]
            lines += [*heading, "```{eval-rst}", f".. automodule:: {name}", "```", ""]
        _write(folder / f"{package}.md", "\n".join(lines))


def _write(path: Path, text: str) -> None:
    """Write a file unless it holds the text already: Sphinx reads again what is newer."""
    if not path.exists() or path.read_text(encoding="utf-8") != text:
        path.write_text(text, encoding="utf-8")


def mend(app: object, what: str, name: str, obj: object, options: object, lines: list[str]) -> None:
    """Docstrings as reStructuredText: `name` is code, and a star or a bar outside of code is one."""
    parts = "\n".join(lines).split("`")
    if len(parts) % 2:  # every backtick has its partner
        for i, part in enumerate(parts):
            if i % 2:
                parts[i] = f"``{part.strip()}``"
            else:
                part = re.sub(r"(\*\w[^*\n]*\w\*)|\*", lambda m: m[1] or r"\*", part)
                parts[i] = part.replace("|", r"\|")
        lines[:] = "".join(parts).split("\n")
    if what in ("attribute", "data", "property"):
        lines[:0] = ["..", ""]  # an empty comment, so that napoleon does not take the words before a colon for a type


def remember_searches() -> None:
    """Let Sphinx look for a name in all names once: types of NumPy and of Python are in thousands of signatures."""
    search, found = PythonDomain.find_obj, {}

    def find_obj(self, env, *asked):
        key = (asked, len(self.objects))
        if key not in found:
            found[key] = search(self, env, *asked)
        return found[key]

    PythonDomain.find_obj = find_obj


def setup(app) -> None:
    """Before napoleon, which has the usual priority of 500."""
    app.connect("autodoc-process-docstring", mend, priority=400)
    remember_searches()


take_notebooks()
list_modules()
