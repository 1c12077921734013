"""Optional packages: what is missing is named, with the one command that installs all of it; and what others add."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tomllib

import pytest
from processes import HANG
from repository import ROOT

from whiptool.errors import InputError
from whiptool.extras import EXTRAS, MissingPackage, Registry, optional, require


def test_extras_are_those_of_the_project():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    stated = {
        extra: {re.split(r"[=><]", package)[0] for package in packages}
        for extra, packages in project["optional-dependencies"].items()
    }
    for extra, packages in EXTRAS.items():
        assert set(packages.values()) == stated[extra], extra
    others = {"notebooks", "docs", "dev", "all"}  # no command imports what is in these
    assert set(stated) - set(EXTRAS) == others


def test_all_that_is_missing_is_told_at_once(monkeypatch):
    for module in ("torch", "cv2", "dynamixel_sdk"):
        monkeypatch.setitem(sys.modules, module, None)
    require("nothing", [])
    require("arrays", ["numpy"])
    with pytest.raises(MissingPackage) as caught:
        require("reproduce", ["torch", "numpy", "cv2", "dynamixel_sdk", "torch"])
    missing = "torch, opencv-python-headless, dynamixel-sdk"
    said = f"reproduce: packages {missing} are not installed; install with: pip install 'whiptool[rl,vision,rig]'"
    assert str(caught.value) == said
    assert caught.value.renamed("--rows") is caught.value


def test_a_module_is_imported_or_its_extra_named(monkeypatch):
    assert optional("json").dumps([1]) == "[1]"
    monkeypatch.setitem(sys.modules, "ezc3d", None)
    with pytest.raises(MissingPackage, match=r"C3D files: the package ezc3d is not .*: pip install 'whiptool\[io\]'"):
        optional("ezc3d", "C3D files")
    with pytest.raises(MissingPackage, match=r"nowhere\.at_all: .* is not installed; .*: pip install nowhere\.at_all"):
        optional("nowhere.at_all")


def test_a_module_that_does_not_load_says_why(monkeypatch, tmp_path):
    (tmp_path / "ray.py").write_text("import no_such_library")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "ray", raising=False)
    with pytest.raises(MissingPackage, match=r"cluster: the package ray is installed but cannot .*'no_such_library'"):
        optional("ray", "cluster")


def install(monkeypatch, folder, module, points):
    """Put a module and its entry points where Python finds installed packages."""
    (folder / "lab.py").write_text(module)
    (folder / "lab-1.0.dist-info").mkdir()
    (folder / "lab-1.0.dist-info" / "METADATA").write_text("Metadata-Version: 2.1\nName: lab\nVersion: 1.0\n")
    (folder / "lab-1.0.dist-info" / "entry_points.txt").write_text(points)
    monkeypatch.syspath_prepend(folder)
    monkeypatch.delitem(sys.modules, "lab", raising=False)


def test_what_installed_packages_add_is_taken_up_once(monkeypatch, tmp_path):
    install(monkeypatch, tmp_path, "five = 5", "[whiptool.numbers]\nfive = lab:five\n")
    known = Registry("numbers", int, {"four": 4})
    assert known.find("Four") == 4
    assert list(known) == ["four"]  # nothing of a package is loaded before it is asked for
    for _ in range(2):
        assert known.find("FIVE") == 5
        assert known == {"four": 4, "five": 5}
    with pytest.raises(InputError, match="numbers: got 'six'; allowed: four, five"):
        known.find("six")
    assert Registry("letters", str) == {}


@pytest.mark.parametrize(
    ("point", "said"),
    [
        (
            "four = lab:five",
            "entry point four of whiptool.numbers: got 'the name four'; allowed: a name that no other object has",
        ),
        ("five = lab:six", "got 'lab:six'; allowed: an object that can be imported"),
        ("five = lab:word", "got 'lab:word'; allowed: an object of type int"),
    ],
)
def test_what_cannot_be_taken_up_is_named(monkeypatch, tmp_path, point, said):
    install(monkeypatch, tmp_path, "five, word = 5, 'five'", f"[whiptool.numbers]\n{point}\n")
    with pytest.raises(InputError, match=re.escape(said)):
        Registry("numbers", int, {"four": 4}).find("five")


LAB = (ROOT / "examples" / "extending" / "lab.py").read_text(encoding="utf-8")
PAGE = (ROOT / "docs" / "extending.md").read_text(encoding="utf-8")
GROUPS = tomllib.loads(PAGE.split("```toml")[1].split("```")[0])["project"]["entry-points"]
POINTS = "\n".join(
    "\n".join([f"[{group}]", *(f"{name} = {home}" for name, home in points.items())])
    for group, points in GROUPS.items()
)
USED = """
import numpy as np
import whiptool as wt
from whiptool.impedance.controller import controller_from_table
from whiptool.optimizers import find_method

from whiptool.adaptation import default_prior
from whiptool.adaptation.twins import FAMILIES
from whiptool.commands.optimize import OptimizeOptions, main
from whiptool.commands.options.rig_options import AdaptOptions
from whiptool.goals.criteria import find_criterion
from whiptool.rig.robots.addresses import robot_at

assert wt.load_model("Short_Whip").whip.length == wt.preset("lemon2024").with_whip(length=0.5).whip.length
assert "short-whip" in wt.presets()
assert find_method("Cross-Entropy").__name__ == "cross_entropy"
assert controller_from_table({"law": "hardening", "c": 50.0}).law.c == 50
law = OptimizeOptions(controller="Hardening").build_controller().law
assert law.kind == "hardening"
assert "law.c" in default_prior(wt.preset("lemon2024"), wt.Controller(law)).names
assert OptimizeOptions(arm="hanging", model="ur5e").build_model().arm != wt.preset("ur5e").arm
assert wt.limits_preset("strong").stall_torque == 9.0
assert robot_at("lagging://lab", wt.preset("ur5e")).rate == 500
assert wt.draw_twin("soft", 3, wt.preset("lemon2024"), wt.Controller(wt.OIAC())).family == "soft"
words = "--minimise Brief --limits strong --max-trials 3 --no-video --json --out run --method random".split()
assert main(words) == 0
for _ in range(2):
    assert len(wt.read_recording("strike.bvh").t) == 50
"""


def test_all_that_an_installed_package_adds_is_found(monkeypatch, tmp_path):
    """In a separate process, for the registries keep what they took up; a format that whiptool refuses is read, too."""
    install(monkeypatch, tmp_path, LAB, POINTS)
    rows = [f"{0.01 * i},{0.01 * i},{0.5}" for i in range(50)]
    (tmp_path / "strike.csv").write_text("\n".join(["t,tip_x,tip_y", *rows]))
    (tmp_path / "strike.bvh").write_text("HIERARCHY\n")
    path = os.pathsep.join(map(str, (tmp_path, ROOT / "examples" / "extending", ROOT)))
    done = subprocess.run(
        [sys.executable, "-c", USED],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": path},
        capture_output=True,
        text=True,
        timeout=HANG,
    )
    assert done.returncode == 0, done.stderr
