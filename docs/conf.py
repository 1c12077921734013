"""Sphinx configuration: `python -m sphinx -W --keep-going -b html docs docs/_build/html`.

With the tag `quick` (`-t quick`), as in the tests, no script of the gallery is run, and the sources are not shown.
"""

from __future__ import annotations

import re
import sys
from importlib.util import find_spec
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent), str(HERE / "_ext")]

from made_pages import list_modules, list_names, make_strike, take_notebooks  # noqa: E402
from sphinx.domains.python import PythonDomain  # noqa: E402

import whiptool  # noqa: E402

project = "whiptool"
author = "The whiptool developers"
project_copyright = "The whiptool developers, MIT licence"
release = version = whiptool.__version__
quick = tags.has("quick")  # noqa: F821  # Sphinx gives the tags

extensions = [
    "mathml",
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_gallery.gen_gallery",
    *(() if quick else ("sphinx.ext.viewcode",)),
]
plot_gallery = str(not quick)
exclude_patterns = ["_build", "_made", "gallery/*.ipynb", "gallery/*.py", "gallery/*.json"]
myst_enable_extensions = ["amsmath", "deflist", "dollarmath"]
myst_heading_anchors = 3
nb_execution_mode = "off"  # the tests execute the notebooks; here they come with their outputs

autodoc_default_options = {"members": True, "ignore-module-all": True}
autodoc_member_order = "bysource"
autodoc_preserve_defaults = not quick  # a tenth of the time
autodoc_use_type_comments = False  # the code has no such comments, and the search for them parses every function
# of the extra `oracle`, which a base class comes from
autodoc_mock_imports = [name for name in ("elastica", "numba") if find_spec(name) is None]
autodoc_typehints = "signature"
napoleon_numpy_docstring = False
napoleon_preprocess_types = False
python_maximum_signature_line_length = 100

sphinx_gallery_conf = {
    "examples_dirs": "../examples",
    "gallery_dirs": "gallery",
    "ignore_pattern": "extending",  # these are on the page of that name
    "filename_pattern": "",  # every script is run
    "abort_on_example_error": True,
    "capture_repr": (),
    "min_reported_time": 1e3,  # how long a script took says more about the machine
    "write_computation_times": False,
    "show_signature": False,
    "show_memory": False,
    "download_all_examples": False,
    "notebook_extensions": set(),
    "remove_config_comments": True,
}

html_math_renderer = "mathml"
html_static_path = ["_static"]
html_extra_path = ["_made/site"]
html_favicon = "_static/whiptool.svg"
html_css_files = ["whiptool.css"]
html_context = {"default_mode": "auto"}
html_theme = "pydata_sphinx_theme"
html_title = f"whiptool {release}"
html_theme_options = {"navigation_with_keys": False, "show_toc_level": 2}
html_sidebars = {"*": []}  # only pages in folders have others next to them


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
list_names()
make_strike()
