"""The source archive and the wheel: they hold what the package needs, and the wheel runs without the repository."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
import yaml
from page_commands import lines_of, parts_of
from processes import HANG
from repository import ROOT

BUILD = "import sys; from setuptools import build_meta; print(getattr(build_meta, sys.argv[1])(sys.argv[2]))"


def built(what: str, source: Path, into: Path) -> Path:
    """Have setuptools build what a folder holds, as `python -m build` does, and return the file."""
    words = [sys.executable, "-c", BUILD, f"build_{what}", str(into)]
    done = subprocess.run(words, cwd=source, capture_output=True, text=True, timeout=HANG, check=True)
    return into / done.stdout.splitlines()[-1]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory) -> Path:
    """The wheel that is built from the source archive of what git knows of."""
    folder = tmp_path_factory.mktemp("wheel")
    if subprocess.run(["git", "rev-parse"], cwd=ROOT, capture_output=True, check=False).returncode:
        pytest.skip("not a git repository: what belongs to it is not known")
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    for name in filter(None, listed.split("\0")):
        if not name.startswith(("tests/", "notebooks/", "benchmarks/")) and (ROOT / name).is_file():
            (folder / "copy" / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(ROOT / name, folder / "copy" / name)
    archive = built("sdist", folder / "copy", folder)
    shutil.unpack_archive(archive, folder / "unpacked", filter="data")
    (source,) = (folder / "unpacked").iterdir()
    return built("wheel", source, folder)


@pytest.mark.slow
def test_the_wheel_holds_the_package_alone(wheel):
    """All files below `whiptool`, data as well as modules, and nothing of the repository around it."""
    held = {name for name in zipfile.ZipFile(wheel).namelist() if ".dist-info/" not in name}
    listed = subprocess.run(["git", "ls-files", "whiptool"], cwd=ROOT, capture_output=True, text=True, check=True)
    assert held == set(listed.stdout.split())


@pytest.fixture(scope="module")
def installed(wheel, tmp_path_factory) -> Path:
    """The wheel unpacked where nothing of the repository is, next to the packages of this environment."""
    folder = tmp_path_factory.mktemp("installed")
    zipfile.ZipFile(wheel).extractall(folder / "packages")
    return folder


def run(installed: Path, *words: str) -> subprocess.CompletedProcess:
    """Run Python in an empty folder with the wheel in front of all other packages."""
    paths = {**os.environ, "PYTHONPATH": str(installed / "packages"), "MPLBACKEND": "Agg"}
    command = [sys.executable, "-P", *words]
    return subprocess.run(command, cwd=installed, env=paths, capture_output=True, text=True, timeout=HANG, check=False)


@pytest.mark.slow
def test_the_first_command_runs_from_the_wheel(installed):
    """What `make demo` of README runs."""
    (line,) = re.findall(r"^demo:.*\n\t\$\(RUN\) (.*)", (ROOT / "Makefile").read_text(), re.MULTILINE)
    done = run(installed, *line.split(), "--no-video", "--out", "first")
    assert done.returncode == 0, done.stderr
    assert "the target was hit" in done.stdout
    assert (installed / "first" / "strike.html").is_file()


@pytest.mark.slow
def test_the_snippet_of_the_readme_runs_from_the_wheel(installed):
    (snippet,) = (body for language, body in parts_of(ROOT / "README.md") if language == "python")
    done = run(installed, "-c", f"{snippet}\nprint(wt.__file__)")
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1].startswith(str(installed / "packages"))
    assert (installed / "strike.png").is_file()


@pytest.mark.slow
@pytest.mark.parametrize("words", [("reproduce", "all"), ("human", "FOLDER")])
def test_what_needs_the_repository_says_so(installed, words):
    done = run(installed, "-m", f"whiptool.{words[0]}", *words[1:])
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "folder papers" in done.stderr
    assert "pip install --editable ." in done.stderr


def test_the_environment_of_conda_installs_this_repository():
    """Python as the project needs it, a compiler, and everything else by pip, in the tested versions."""
    needs = yaml.safe_load((ROOT / "environment.yml").read_text(encoding="utf-8"))["dependencies"]
    python = re.search(r'requires-python = ">=([\d.]+)"', (ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    assert python is not None
    assert needs[:3] == [f"python={python[1]}", "pip", "cxx-compiler"]
    assert needs[3] == {"pip": ["--constraint requirements.lock", "--editable ."]}


def uv_commands() -> list[str]:
    """The commands of the installation's section on uv."""
    page = (ROOT / "docs" / "install.md").read_text(encoding="utf-8")
    return lines_of(re.findall(r"## With uv\n+```sh\n(.*?)```", page, re.DOTALL)[0])


@pytest.mark.hours
def test_uv_installs_as_the_page_says(tmp_path):
    """From a package index, into an empty environment: some minutes."""
    if shutil.which("uv") is None:
        pytest.skip("uv is not installed: pip install uv")
    for name in ("pyproject.toml", "requirements.lock", "README.md", "LICENSE"):
        shutil.copyfile(ROOT / name, tmp_path / name)
    shutil.copytree(ROOT / "whiptool", tmp_path / "whiptool")
    names = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "VIRTUAL_ENV")}
    assert len(uv_commands()) == 3
    for line in uv_commands():
        done = subprocess.run(["sh", "-c", line], cwd=tmp_path, env=names, capture_output=True, text=True, check=False)
        assert done.returncode == 0, f"{line}\n{done.stderr}"
    assert "the target was hit" in done.stdout
