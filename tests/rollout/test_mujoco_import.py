"""What MuJoCo warns of outside a rollout."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from whiptool.rollout.mujoco_import import mujoco


def test_a_warning_is_logged_once_and_no_file_is_left_in_the_working_folder(tmp_path, monkeypatch, caplog, capfd):
    monkeypatch.chdir(tmp_path)
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><body><joint/><joint type='slide'/><geom size='.1'/></body></worldbody></mujoco>"
    )
    for _ in range(3):
        data = mujoco.MjData(model)
        data.qpos[1] = np.nan
        mujoco.mj_step(model, data)
    assert [
        record.getMessage() for record in caplog.records if "huge value in QPOS at DOF 1" in record.getMessage()
    ] == ["MuJoCo warns: Nan, Inf or huge value in QPOS at DOF 1. The simulation is unstable."]
    assert list(Path.cwd().iterdir()) == []
    assert "WARNING" not in capfd.readouterr().err
