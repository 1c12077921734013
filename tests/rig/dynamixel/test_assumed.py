"""Registers that change what a command means are compared with what strikes assume, before anything is armed."""

from __future__ import annotations

import pytest

import whiptool as wt
from whiptool.commands import dynamixel as command
from whiptool.errors import InputError
from whiptool.impedance import OIAC, Controller
from whiptool.rig.control_loop import RigLoop, StepClock
from whiptool.rig.dynamixel import Joints
from whiptool.rig.dynamixel.assumed import ASSUMED, check_registers, mismatches
from whiptool.rig.loop_options import LoopOptions

pytest.importorskip("dynamixel_sdk")

WRONG = {
    "drive_mode": 1,
    "homing_offset": 1024,
    "pwm_limit": 400,
    "secondary_id": 1,
    "shutdown": 0,
    "status_return_level": 1,
}


def test_each_register_has_a_wrong_value_here():
    assert set(WRONG) == {assumed.name for assumed in ASSUMED}


@pytest.mark.parametrize("name", WRONG)
def test_a_servo_that_is_set_up_otherwise_is_refused_with_the_cure(bus, twin, name, tmp_path, capsys):
    """A homing offset of 1024 struck 90 degrees off."""
    check_registers(bus)
    bus.write(2, name, WRONG[name])
    model, options = wt.preset("lemon2024"), LoopOptions(settle=0.0, go_back=False, rehearse=False)
    loop = RigLoop(Joints(bus), model, Controller(OIAC()), options=options, clock=StepClock())
    with pytest.raises(InputError) as refused:
        loop.run(wt.Strike((0.3, 0.5), (0.3, 0.5), 0.1), path=tmp_path / "cycles.log")
    said = str(refused.value)
    assert said.startswith(f"servo 2: {name}: got {WRONG[name]}; allowed: ")
    assert f"--port {twin.port} --baud 1000000 --ids 2 --for-strikes" in said
    assert "\n" not in said
    assert twin.state()["torque_changes"] == []
    assert not (tmp_path / "cycles.log").exists()
    bus.close()
    assert command.main(["--port", twin.port, "--ids", "2", "--for-strikes"]) == 0
    assert f"{name} is {WRONG[name]}, strikes assume" in capsys.readouterr().out
    with twin.bus() as again:
        assert mismatches(again, 2) == []


def test_the_voltage_limit_of_current_mode_is_set_anew(bus, twin):
    """A client before us may have left a low Goal PWM, which caps the motor in current mode."""
    from whiptool.rig.safety import Safety

    for id in (1, 2):
        bus.write(id, "operating_mode", 0)
        bus.write(id, "goal_pwm", 100)
    safety = Safety(Joints(bus))
    safety.arm()
    assert [bus.read(id, "goal_pwm") for id in (1, 2)] == [885, 885]
    safety.disarm()
