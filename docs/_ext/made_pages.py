"""Pages and files that the build makes: notebooks, the reference of names and modules, and a strike to play with."""

from __future__ import annotations

import inspect
import pkgutil
import re
from pathlib import Path

import whiptool as wt
from whiptool.viz.page import strike_page

DOCS = Path(__file__).resolve().parents[1]
GROUPS = {  # headings of the public names, by the packages that hold them
    "models": "Arm, whip, strike",
    "limits": "Limits",
    "impedance": "Controllers",
    "rollout": "Simulators",
    "goals": "Targets",
    "objective": "Searches",
    "viz": "Pictures",
    "recording": "Recordings and fits",
    "adaptation": "Unknown whips",
    "rl": "Policies, maps, comparisons",
    "runs": "Citations",
}
WITH_OTHERS = {"optimizers": "objective", "correction": "objective", "identification": "recording", "strike_map": "rl"}
WITH_OTHERS |= {"comparison": "rl"}


def take_notebooks() -> None:
    """Copy the notebooks that exist into the folder `notebooks`, with a page that lists them."""
    source, folder = DOCS.parent / "notebooks", DOCS / "notebooks"
    folder.mkdir(exist_ok=True)
    found = sorted(source.glob("[0-9]*.ipynb")) if source.is_dir() else []
    _keep_only(folder, "*.ipynb", {path.name for path in found})
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
    folder = DOCS / "api"
    folder.mkdir(exist_ok=True)
    pages = {"whiptool": ["whiptool"]}
    for module in pkgutil.walk_packages(wt.__path__, "whiptool."):
        package = ".".join(module.name.split(".")[:2])
        at_top = package == module.name and not module.ispkg
        if not module.name.endswith("__main__"):  # these are only run
            pages.setdefault("whiptool" if at_top else package, []).append(module.name)
    _keep_only(folder, "*.md", {f"{package}.md" for package in pages})
    for package, names in pages.items():
        lines = [f"# {package}", ""]
        for name in names:
            heading = [] if name == package else [f"## {name}", ""]
            lines += [*heading, "```{eval-rst}", f".. automodule:: {name}", "```", ""]
        _write(folder / f"{package}.md", "\n".join(lines))


def list_names() -> None:
    """The public names of whiptool by what they are for, each with the first sentence of its docstring."""
    rows: dict[str, list[str]] = {group: [] for group in GROUPS}
    for name in (x for x in wt.__all__ if not x.startswith("__")):
        thing = getattr(wt, name)
        module = "whiptool.optimizers" if thing is wt.METHODS else thing.__module__
        link = f"`wt.{name}`" if thing is wt.METHODS else f"{{py:obj}}`wt.{name} <{module}.{name}>`"
        says = "The search methods by name." if thing is wt.METHODS else _first_sentence(thing)
        package = module.split(".")[1]
        rows[WITH_OTHERS.get(package, package)].append(f"| {link} | {says} |")
    lines = []
    for group, title in GROUPS.items():
        lines += [f"### {title}", "", "| name | what |", "|---|---|", *rows[group], ""]
    _write(DOCS / "_made" / "names.md", "\n".join(lines))


def make_strike() -> None:
    """The page of a strike, as every run leaves one, which the home page shows."""
    model, target = wt.preset("ur5e"), wt.Target((1.2, 0.3, 0.5))
    strike = wt.load_map("ur5e").strike(target)
    page = strike_page(model, wt.CompiledRollout(model).trajectory(strike), target)
    _write(DOCS / "_made" / "site" / "strike.html", page)


def _first_sentence(thing: object) -> str:
    """Return the first sentence of a docstring on one line, as a cell of a table."""
    text = " ".join((inspect.getdoc(thing) or "").split("\n\n")[0].split())
    first = re.split(r"(?<=[.:])\s(?=[A-Z`])", text)[0]
    return first.removesuffix(":").removesuffix(".").replace("|", r"\|")


def _keep_only(folder: Path, pattern: str, names: set[str]) -> None:
    """Remove what an earlier build made and this one does not."""
    for old in folder.glob(pattern):
        if old.name not in names:
            old.unlink()


def _write(path: Path, text: str) -> None:
    """Write a file unless it holds the text already: Sphinx reads again what is newer."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if not path.exists() or path.read_text(encoding="utf-8") != text:
        path.write_text(text, encoding="utf-8")
