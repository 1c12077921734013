"""Learning an unknown whip from the command line."""

from __future__ import annotations

import json
import shutil

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
