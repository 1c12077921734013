"""Robots' files that no parser should see are refused, whatever they are made of, and all others pass."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from whiptool.errors import InputError
from whiptool.models.mjcf import read_mjcf
from whiptool.models.urdf import read_urdf

BODY = '<body><joint/><geom size="0.1"/>{}</body>'
MJCF = "<mujoco>{}<worldbody>{}</worldbody></mujoco>"


def read(folder: Path, text: str, suffix: str = "xml") -> object:
    (folder / f"x.{suffix}").write_text(text)
    return read_urdf(folder / "x.urdf") if suffix == "urdf" else read_mjcf(folder / "x.xml")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (MJCF.format("", '<replicate count="100000"><body/></replicate>'), "replicas counted"),
        (MJCF.format("", "<replicate count='300'>" * 2 + "<body/>" + "</replicate>" * 2), "replicas counted"),
        (MJCF.format("", '<body><flexcomp name="f" type="grid" count="1000 1000 1"/></body>'), "replicas counted"),
        (MJCF.format("", '<body><composite type="cable" count="99999 1 1"/></body>'), "replicas counted"),
        (MJCF.format('<asset><texture builtin="flat" width="100000000" height="9"/></asset>', ""), "width 100000000"),
        (MJCF.format('<asset><hfield name="h" nrow="1000000" ncol="2" size="1 1 1 1"/></asset>', ""), "nrow 1000000"),
        (MJCF.format("", "<body>" * 5000), "within elements"),
        ("<!--" * 300_000, "MuJoCo compiles"),
        ("<a '" * 300_000, "MuJoCo compiles"),
        ('<a b="' * 300_000, "MuJoCo compiles"),
        (MJCF.format('<include file="x.xml"/>', ""), "at most 100 included files"),
        (MJCF.format('<include file="/dev/zero"/>', ""), "not a pipe or a device"),
        (MJCF.format('<compiler meshdir="/dev"/><asset><mesh file="zero"/></asset>', ""), "not a pipe or a device"),
    ],
)
def test_mjcf_that_would_not_end_is_refused_at_once(text: str, said: str, tmp_path: Path) -> None:
    begun = time.process_time()
    with pytest.raises(InputError, match=said):
        read(tmp_path, text)
    assert time.process_time() - begun < 10


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("<robot>" + "<link>" * 5000 + "</link>" * 5000 + "</robot>", "within elements"),
        ('<!DOCTYPE r [<!ENTITY a "&b;&b;"><!ENTITY b "x">]><robot name="&a;"/>', "entities"),
        ("<robot>" + '<link name="a"/>' * 30_000 + "</robot>", "20000 elements"),
    ],
)
def test_urdf_that_would_not_end_is_refused_at_once(text: str, said: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=said):
        read(tmp_path, text, "urdf")


def test_a_tip_without_a_name_is_found_by_its_number(tmp_path: Path) -> None:
    assert read(tmp_path, MJCF.format("", BODY.format(BODY.format("")))).n == 2


def test_what_is_said_in_comments_and_what_is_replicated_a_few_times_passes(tmp_path: Path) -> None:
    """Three replicas of a shape, on the second of two bodies."""
    many = "<!-- <replicate count='1000000'> -->"
    few = '<replicate count="3" offset="1 0 0"><geom size="0.1"/></replicate>'
    arm = read(tmp_path, MJCF.format(many, BODY.format(f'<body name="tip"><joint/>{few}</body>')))
    assert arm.n == 2
    assert arm.links[1].mass == pytest.approx(3 * arm.links[0].mass)
