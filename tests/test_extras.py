"""Optional packages: what is missing is named, with the one command that installs all of it."""

from __future__ import annotations

import re
import sys
import tomllib

import pytest
from repository import ROOT

from whiptool.extras import EXTRAS, MissingPackage, optional, require


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
