"""Learning an unknown whip from the command line."""

from __future__ import annotations

import json
import shutil

import pytest

from whiptool.commands import adapt


def test_command_line_hits_and_resumes(tmp_path, capsys):
    out = tmp_path / "run"
    words = ["--target", "1.2", "0.1", "--camera", "tip", "--family", "kin", "--seed", "5", "--whip", "uniform"]
    assert adapt.main([*words, "--preset", "table4", "--json", "--out", str(out)]) == 0
    said = capsys.readouterr()
    result = json.loads(said.out)
    assert result["hit"]
    assert result["miss_distance"][-1] <= 0.06
    assert "predicted hit probability" in said.err
    shutil.rmtree(out / f"strike-{result['strikes']:04d}")
    assert adapt.main(["--resume", str(out), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["miss_distance"] == result["miss_distance"]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (
            "--diameter 0.006",
            "--diameter: got 0.006; allowed: only with --material, or with --youngs-modulus",
        ),
        ("--diameter 0.006 --preset table4", "--diameter: got 0.006; allowed: only with --material, or with"),
        ("--length 1.2", "--length: got 1.2; allowed: only with --material; or give --model or --prior"),
        ("--diameter 0.006 --density 900", "--youngs-modulus: got nothing; allowed: a value: --youngs-modulus, --diam"),
    ],
)
def test_numbers_of_a_whip_whose_material_is_not_given_are_refused(words, said, capsys):
    """A diameter alone was told to need a Young's modulus."""
    assert adapt.main(words.split()) == 2
    assert said in capsys.readouterr().err
