"""A pendulum fitted from the command line: its names, its classes, and bad input."""

from __future__ import annotations

import json

import numpy as np
import pytest
import tomli_w
from pendulum_data import DATA
from pendulum_swing import pendulum

from whiptool.commands import identify
from whiptool.commands.identify import full_names
from whiptool.errors import InputError
from whiptool.identification import problem, solver
from whiptool.identification.plant import read_bare_arm, write_bare_arm
from whiptool.models.parameters import ArmLink

TWO = pendulum((ArmLink(0.2, 0.2), ArmLink(0.1, 0.2, 0.09, 3e-4, 1e-4)), (1e-3, 0.0), 0.2, (0.0, 2e-3), 9.8)


def test_names_of_one_link_and_of_all():
    assert full_names(("com", "length[0]", "gravity"), TWO) == (
        "link.com[0]", "link.com[1]", "link.length[0]", "gravity"
    )  # fmt: skip
    with pytest.raises(InputError, match="--free"):
        full_names(("k",), TWO)
    with pytest.raises(InputError) as refused:
        full_names(("delay",), TWO)  # of recordings that films and logs make, which a pendulum does not have
    assert "shift_x" not in str(refused.value)
    assert "gravity" in str(refused.value)


@pytest.mark.slow
@pytest.mark.skipif(not DATA.is_dir(), reason=f"no recorded pendulum in {DATA}")
@pytest.mark.figures
def test_a_real_double_pendulum_from_the_command_line(tmp_path, capsys):
    """Three pieces of a second each, one more held out: as many unseen directions as the chain has, and the angles,
    of radians, predicted to 10 mrad (from 22 longer pieces: `test_pendulum_data`)."""
    data = np.load(DATA / "double.npz")
    some = {key: data[key][[0, 1, 2, 11], :1000] for key in ("angle", "velocity")}
    np.savez(tmp_path / "double.npz", dt=data["dt"], **some)
    (tmp_path / "double.toml").write_text(tomli_w.dumps({"zero": float(np.pi), "every": 10, "sigma": 2e-3}))
    links = [{"mass": m, "length": 0.2, "dry_friction": 1e-3} for m in (0.2, 0.1)]
    (tmp_path / "guess.toml").write_text(tomli_w.dumps({"links": links}))
    free = ["mass", "com", "inertia", "friction", "dry_friction", "drag", "length[0]"]
    words = [tmp_path / "double.npz", "--drive", "free", "--model", tmp_path / "guess.toml", "--pieces", 0.3]
    words += ["--free", *free, "--starts", 2, "--held-out", f"{tmp_path / 'double.npz'}#3", "--out", tmp_path / "run"]
    assert identify.main([*map(str, words), "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    print("held out [mrad]", 1e3 * result["held_out_rmse"])
    assert result["held_out_rmse"] < 10e-3
    assert len(result["flat_directions"]) == 3
    found = {p["name"]: p for p in result["parameters"]}
    assert found["link.length[0]"]["class"] == "well determined"
    assert found["link.length[0]"]["value"] == pytest.approx(0.1732, abs=2e-3)
    assert found["link.com[1]"]["class"] == "flat"
    assert not result["starts"][0]["failed"]
    assert read_bare_arm(tmp_path / "run" / "identified.toml").arm.n == 2
    assert "held out" in (tmp_path / "run" / "report.html").read_text()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("--model lemon2024", "--model"),
        ("--clamp 0", "--clamp"),
        ("--nodes 3 --model {folder}/two.toml", "--nodes"),
        ("--model {folder}/two.toml", "--free"),
        ("--model {folder}/two.toml --free com --held-out 7.npz", "7.npz"),
        ("--model {folder}/one.toml --free com", "2 links"),
        ("--model {folder}/two.toml --free com --mount wall", "--mount"),
    ],
)
def test_bad_input_is_one_line_and_writes_nothing(tmp_path, capsys, words, said):
    write_bare_arm(TWO.model, tmp_path / "two.toml")
    write_bare_arm(pendulum((ArmLink(0.2, 0.2),)).model, tmp_path / "one.toml")
    np.savez(tmp_path / "swing.npz", dt=0.01, angle=np.zeros((30, 2)))
    options = [*words.format(folder=tmp_path).split(), "--drive", "free", "--out", str(tmp_path / "run")]
    assert identify.main([str(tmp_path / "swing.npz"), *options]) == 2
    printed = capsys.readouterr().err
    assert said in printed
    assert len(printed.splitlines()) == 1
    assert not (tmp_path / "run").exists()


def test_a_fit_that_did_not_converge_ends_with_its_own_status(tmp_path, capsys, monkeypatch):
    """A pendulum of one link swings at sqrt(g / L); its length is looked for from 20 % off."""
    length, t = 0.3, np.arange(0, 1, 0.01)
    swing = 0.05 * np.cos(np.sqrt(9.81 / length) * t)
    np.savez(tmp_path / "swing.npz", dt=0.01, angle=swing[:, None])
    write_bare_arm(pendulum((ArmLink(0.2, 1.2 * length, 1.2 * length, 1e-9),)).model, tmp_path / "one.toml")
    few = {"max_iterations": 1}
    monkeypatch.setattr(problem, "solve", lambda *given, **how: solver.solve(*given, **{**how, **few}))
    words = [tmp_path / "swing.npz", "--drive", "free", "--model", tmp_path / "one.toml", "--free", "com"]
    assert identify.main([*map(str, words), "--out", str(tmp_path / "run"), "--json"]) == 1
    printed = capsys.readouterr()
    assert not json.loads(printed.out)["converged"]
    assert "not converged: the largest number of iterations" in printed.err
    assert (tmp_path / "run" / "identified.toml").exists()


def test_a_pendulum_that_is_given_as_a_model_of_a_whip_is_told_to_be_one(tmp_path, capsys):
    """The refusals named tables and keys of the files, and not what to give instead."""
    write_bare_arm(TWO.model, tmp_path / "two.toml")
    (tmp_path / "config.toml").write_text('command = "identify"\n[options]\ndrive = "free"\n')
    np.savez(tmp_path / "swing.npz", dt=0.01, angle=np.zeros((30, 2)))
    fitted = f"the pendulum that this run fitted is {tmp_path / 'identified.toml'}, for --drive free"
    for model, more, said in (
        ("two.toml", [], "this file is a pendulum's: add --drive free"),
        ("config.toml", [], fitted),
        ("config.toml", ["--drive", "free"], fitted),
    ):
        assert identify.main([str(tmp_path / "swing.npz"), "--model", str(tmp_path / model), *more]) == 2
        printed = capsys.readouterr().err
        assert printed.startswith("whiptool: --model: got ")
        assert said in printed
        assert len(printed.splitlines()) == 1
