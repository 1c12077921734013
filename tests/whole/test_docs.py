"""The documentation: it builds without a warning, its snippets and examples run, and what it says of options, defaults
and JSON keys is what the code has."""

from __future__ import annotations

import contextlib
import dataclasses
import importlib.util
import inspect
import io
import json
import math
import os
import re
import shlex
import subprocess
import sys
from functools import cache
from importlib import import_module
from pathlib import Path

import pytest
from page_commands import DOCS, FENCE, PAGES, SPAN, Command, lines_of, name_of, needs_of, parts_of
from processes import HANG
from repository import ROOT
from undrawn import leave_out_pictures

import whiptool
from whiptool.commands import cli
from whiptool.extras import EXTRAS

EXAMPLES = sorted((ROOT / "examples" / "extending").glob("*.py"))
TUTORIAL = DOCS / "tutorial.md"
COMMAND = re.compile(r"^(?:\S*python3? -m whiptool\.|whiptool )(.*)$")
TWOFOLD = ("rig", "robot", "map", "recording")  # commands whose second word says what they do
COMMANDS = (
    *(set(cli.COMMANDS) - set(TWOFOLD)),
    "adapt next",
    "map build",
    "map strike",
    "rig strike",
    "rig learn",
    "robot strike",
    "robot recover",
    "recording show",
    "recording convert",
    "rig.dynamixel",
    "rig.emulator",
    "rig.ur_emulator",
)


def fences(text: str, language: str) -> list[str]:
    """The bodies of a page's code blocks in one language."""
    return [body for name, body in FENCE.findall(text) if name == language]


def tables(text: str, header: str) -> list[list[str]]:
    """Cells of the rows of every table whose header row is this."""
    rows, inside = [], False
    for line in text.splitlines():
        if line == header:
            inside = True
        elif not line.startswith("|"):
            inside = False
        elif inside and not line.startswith("|---"):
            rows.append([cell.strip() for cell in line.strip("|").split(" | ")])
    return rows


def commands(text: str) -> list[list[str]]:
    """The words behind `whiptool` of every command in a text's code, as `["rig", "strike", "--json"]`."""
    code = [line for body in fences(text, "sh") for line in body.replace("\\\n", " ").splitlines()]
    code += SPAN.findall(FENCE.sub("", text))
    found = []
    for line in code:
        match = COMMAND.match(line.split(" #")[0].strip())
        if match:
            found.append(shlex.split(match[1]))
    return found


@cache
def options_of(command: str) -> frozenset[str]:
    """The options that `--help-all` of a command lists."""
    module, *words = command.split()
    main = _main(module)
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.suppress(SystemExit):
        main([*words, "--help-all"])
    return frozenset(re.findall(r"--[a-z][\w-]*", said.getvalue()))


def _main(name: str) -> cli.Main:
    return cli.main_of(name.removeprefix("rig."))


def named(words: list[str]) -> str:
    """The command that words call: the first, or the first two."""
    twofold = words[0] in TWOFOLD or " ".join(words[:2]) in COMMANDS
    return " ".join(words[:2]) if twofold else words[0]


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_commands_and_their_options_exist(page):
    text = page.read_text(encoding="utf-8")
    for words in commands(text):
        if not words or words[0].startswith("-") or words[0].isupper():  # `whiptool --version`, `COMMAND`
            continue
        command = named(words)
        assert command in COMMANDS or (len(words) == 1 and command in TWOFOLD), (
            f"{page.name}: whiptool {' '.join(words)}"
        )
        given = {word.split("=")[0] for word in words if re.match(r"--[a-z]", word)} - {"--help", "--help-all"}
        assert given <= options_of(command), f"{page.name}: {command} has no {given - options_of(command)}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_options_without_a_command_belong_to_some_command(page):
    known = frozenset().union(*map(options_of, COMMANDS)) | {"--version", "--help", "--help-all"}
    spans = SPAN.findall(FENCE.sub("", page.read_text(encoding="utf-8")))
    for span in (x for x in spans if not x.startswith("python benchmarks/")):
        for word in re.findall(r"(?:^|\s)(--[a-z][\w-]*)", span):
            assert word in known, f"{page.name}: {span}"


def test_the_readme_is_one_page():
    lines = (ROOT / "README.md").read_text(encoding="utf-8").splitlines()
    assert len(lines) <= 100
    assert [line for line in lines if len(line) > 100] == []


def value_in_code(expression: str) -> object:
    """What an expression of the tables says: `arm` is the paper's, `settings` SAC's, `default` an argument's."""
    from whiptool.rl.settings import SACSettings

    def default(function, name: str) -> object:
        return inspect.signature(function).parameters[name].default

    scope = {"arm": whiptool.preset("lemon2024").arm, "settings": SACSettings(), "default": default}
    # modules by name: a package may export a function of its module's name
    code = re.sub(r"whiptool(?:\.[a-z_]\w*)+", lambda match: _longest_module(match[0]), expression)
    return eval(code, {**scope, "module": import_module})


def _longest_module(name: str) -> str:
    """`module("whiptool.models.strike").default_bounds` of `whiptool.models.strike.default_bounds`."""
    parts = name.split(".")
    for count in range(len(parts), 0, -1):
        with contextlib.suppress(ImportError):
            import_module(".".join(parts[:count]))
            return ".".join([f'module("{".".join(parts[:count])}")', *parts[count:]])
    raise AssertionError(name)


DEFAULTS = [
    row
    for page in PAGES
    for first in ("default", "setting", "guard", "limit")
    for row in tables(page.read_text(encoding="utf-8"), f"| {first} | value | in the code |")
]


@pytest.mark.parametrize(("name", "stated", "place"), DEFAULTS, ids=[row[0] for row in DEFAULTS])
def test_stated_defaults_are_those_of_the_code(name, stated, place):
    said = eval(stated.strip("`"), {"pi": math.pi})
    assert value_in_code(place.strip("`")) == pytest.approx(said, rel=1e-12)


def test_there_are_defaults_to_check():
    assert len(DEFAULTS) > 45


def test_every_key_of_a_model_file_is_documented():
    from whiptool.models import ArmLink, WhipParameters, WhipProfile

    text = (DOCS / "file-formats.md").read_text(encoding="utf-8")
    models = text[text.index("## Models") : text.index("## Recordings")]
    for kind in (WhipParameters, WhipProfile, ArmLink):
        for f in dataclasses.fields(kind):
            assert re.search(rf"`[\w.\[\]]*\b{f.name}`", models), f.name


def test_every_key_of_a_sidecar_is_documented():
    from whiptool.recording.readers.sidecar import CLOCK, COMMON, FILM, PIXELS, SPACE, VIEW

    text = (DOCS / "file-formats.md").read_text(encoding="utf-8")
    keys = " ".join(row[0] for row in tables(text, "| key | of | what |"))
    for key in (*COMMON, *SPACE, *VIEW, *PIXELS, *FILM, *CLOCK):
        assert re.search(rf"`{key}\b", keys), key


def test_every_key_of_a_pendulum_and_its_swings_is_documented():
    from whiptool.identification.plant import EACH, SHARED
    from whiptool.models.parameters import ArmParameters
    from whiptool.recording.readers.angles import SIDECAR

    text = (DOCS / "file-formats.md").read_text(encoding="utf-8")

    def documented(header: str) -> list[str]:
        return [word for row in tables(text, header) for word in re.findall(r"`(?:links\[\])?\.?(\w+)`", row[0])]

    assert sorted(documented("| key | unit | default | of a pendulum |")) == sorted(
        (*ArmParameters.QUANTITIES, *EACH, *SHARED)
    )
    assert sorted(documented("| key | unit | default | of a swing's file |")) == sorted(SIDECAR)


def test_every_option_of_a_strike_is_in_the_tables_of_formats():
    """The formats that are read are those that are listed."""
    from whiptool.recording.readers import READERS

    text = (DOCS / "file-formats.md").read_text(encoding="utf-8")
    listed = [row[2].split(".")[-1].rstrip("`") for row in tables(text, "| format | recognised by | reader |")]
    homes = {"csv": "tracks", "npz": "strike_recording", "video": "footage", "log": "joint_log"}
    assert sorted(listed) == sorted(homes.get(name, name) for name in READERS)


def environment() -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": str(ROOT)}


@pytest.mark.slow
@pytest.mark.parametrize("script", EXAMPLES, ids=lambda script: script.stem)
def test_examples_run(script, tmp_path):
    done = subprocess.run(
        [sys.executable, str(script)], cwd=tmp_path, env=environment(), capture_output=True, text=True, timeout=HANG
    )
    assert done.returncode == 0, done.stderr


def test_every_example_is_shown():
    shown = re.findall(
        r"literalinclude} \.\./examples/extending/(\S+)", (DOCS / "extending.md").read_text(encoding="utf-8")
    )
    assert sorted(shown) == [script.name for script in EXAMPLES]


WITH_SNIPPETS = [p for p in PAGES if p.parent.name == "how-to" and fences(p.read_text(encoding="utf-8"), "python")]


@pytest.mark.slow
@pytest.mark.parametrize("page", WITH_SNIPPETS, ids=name_of)
def test_snippets_of_the_how_to_run(page, tmp_path):
    """Where nothing is installed but what the page says it needs."""
    if page.stem == "gymnasium":
        pytest.importorskip("stable_baselines3", reason="a snippet trains with Stable-Baselines3")
    text, named = page.read_text(encoding="utf-8"), needs_of(page)
    hidden = {module for extra, modules in EXTRAS.items() if extra not in named for module in modules}
    code = "\n".join([f"import core_installation; core_installation.hide({hidden!r})", *fences(text, "python")])
    paths = {**environment(), "PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "tests/helpers")])}
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, env=paths, capture_output=True, text=True, timeout=HANG
    )
    assert done.returncode == 0, done.stderr


@dataclasses.dataclass(frozen=True)
class Tutorial:
    """The tutorial as it was done.

    Args:
        folder: In which.
        shown: What the page shows of what a command prints, and what it printed.
    """

    folder: Path
    shown: list[tuple[str, str]]


@pytest.fixture(scope="module")
def tutorial(tmp_path_factory) -> Tutorial:
    """The whole tutorial, snippets and commands in their order.

    A snippet goes on where the one before it ended, as in an interpreter that stays open.
    """
    for module in ("torch", "cv2", "pyarrow"):
        if importlib.util.find_spec(module) is None:
            pytest.skip(f"the tutorial needs {module}")
    folder, names = tmp_path_factory.mktemp("tutorial"), {"__name__": "tutorial"}
    shown: list[tuple[str, str]] = []
    with pytest.MonkeyPatch.context() as patch:
        leave_out_pictures(patch)
        do_tutorial(folder, names, shown)
    return Tutorial(folder, shown)


def do_tutorial(folder: Path, names: dict[str, object], shown: list[tuple[str, str]]) -> None:
    """Run the tutorial's parts in their order, and append what it shows of what was printed."""
    said = ""
    for language, body in parts_of(TUTORIAL):
        if language == "python":
            with contextlib.chdir(folder):
                exec(compile(body, "tutorial.md", "exec"), names)
        elif language == "text":
            shown.append((body, said))
        elif language == "sh":
            for command in (Command(TUTORIAL, line) for line in lines_of(body)):
                if command.elsewhere:
                    continue
                done = command.run(folder)
                assert done.returncode == 0, f"{command}\n{done.stdout}\n{done.stderr[-2000:]}"
                said = done.stdout


def documented_keys(command: str) -> set[str]:
    """First words of the keys that json.md lists for a command."""
    text = (DOCS / "json.md").read_text(encoding="utf-8")
    section = text.split(f"\n## {command}\n")[1].split("\n## ")[0]
    cells = [row[0] for row in tables(section, "| key | unit | what |")]
    return {name.split(".")[0] for cell in cells for name in re.findall(r"`([\w.]+)`", cell)}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("command", "folder"),
    [
        ("optimize", "slow"),
        ("identify", "fitted"),
        ("rig strike", "rig"),
        ("adapt", "adapted"),
        ("train", "policy"),
    ],
)
def test_the_tutorial_runs_and_results_have_the_documented_keys(tutorial, command, folder):
    result = json.loads((tutorial.folder / folder / "result.json").read_text(encoding="utf-8"))
    assert set(result) == documented_keys(command)


NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:e[-+]\d+)?")
COMPUTING = re.compile(r"(in|no longer decreases;) [\d.]+ s\b")  # how long it took here


@pytest.mark.slow
def test_the_tutorial_shows_what_its_commands_print(tutorial):
    """Word by word; numbers to what other processors change in them."""
    assert len(tutorial.shown) == 3
    for shown, printed in tutorial.shown:
        page, here = (COMPUTING.sub(r"\1 0 s", text).strip().splitlines() for text in (shown, printed))
        for line, said in zip(page, here[: len(page)], strict=True):
            assert NUMBER.sub("0", line) == NUMBER.sub("0", said), f"the page: {line}\nprinted: {said}"
            numbers = [[float(x) for x in NUMBER.findall(text)] for text in (line, said)]
            assert numbers[0] == pytest.approx(numbers[1], rel=0.03, abs=0.01), f"the page: {line}\nprinted: {said}"


@pytest.mark.slow
def test_the_tutorial_says_what_its_fits_find(tutorial):
    def classes(name: str) -> set[str]:
        return {p["class"] for p in json.loads((tutorial.folder / name / "result.json").read_text())["parameters"]}

    assert classes("fitted") == {"traded"}
    assert classes("weighed") == {"well determined"}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("command", "words"),
    [
        ("simulate", ["--strike", "-1.36", "0.47", "1.73", "1.41", "0.95", "--no-video"]),
        ("compare", ["--quick", "--targets", "2", "--methods", "directl", "--max-trials", "5", "--workers", "1"]),
    ],
)
def test_other_results_have_the_documented_keys(command, words, tmp_path, capsys):
    main = cli.main_of(command)
    assert main([*words, "--json", "--out", str(tmp_path / "run")]) == 0
    assert set(json.loads(capsys.readouterr().out)) == documented_keys(command)


# what a browser loads with a page; links are followed by people only
FROM_A_NETWORK = re.compile(r'<(?:script|img|iframe|video|source|link)\b[^>]*\s(?:src|href)="(?:https?:)?//[^>]*>')


@pytest.mark.slow
def test_the_documentation_builds_without_a_warning(tmp_path):
    """Its pictures are drawn by `test_gallery`, and by `make docs`."""
    for module in ("sphinx", "myst_nb", "pydata_sphinx_theme"):
        if importlib.util.find_spec(module) is None:
            pytest.skip(f"{module} is not installed: pip install whiptool[docs]")
    command = [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", "-b", "html", "-t", "quick"]
    done = subprocess.run(
        [*command, "-d", str(tmp_path / "doctrees"), str(DOCS), str(tmp_path / "html")],
        env=environment(),
        capture_output=True,
        text=True,
        timeout=HANG,
    )
    assert done.returncode == 0, done.stderr
    for page in (
        "index",
        "tutorial",
        "derivations",
        "json",
        "api/whiptool.models",
        "notebooks/index",
        "gallery/robot",
        "strike",
    ):
        assert (tmp_path / "html" / f"{page}.html").exists(), page
    for built in (tmp_path / "html").rglob("*.html"):
        assert not FROM_A_NETWORK.search(built.read_text(encoding="utf-8")), built


def test_every_make_target_of_the_pages_is_in_the_makefile():
    """A newcomer's first commands."""
    targets = set(re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    pages = [*ROOT.glob("*.md"), *DOCS.glob("*.md")]
    named = {
        (page.name, x)
        for page in pages
        if page.name not in ("CHANGELOG.md", "changelog.md")
        for x in re.findall(r"(?:^|`)make ([a-z][\w-]*)", page.read_text(), re.MULTILINE)
    }
    assert ("README.md", "test") in named
    assert not {(page, target) for page, target in named if target not in targets}
