"""The dashboard server of an emulated UR: one line of text is asked, one is answered."""

from __future__ import annotations

from whiptool.rig.robots.robot import IN_LOCKSTEP
from whiptool.rig.ur_emulator.ur_controller import UrController

GREETING = b"Connected: Universal Robots Dashboard Server\n"
_MODES = {"normal": "NORMAL", "protective": "PROTECTIVE_STOP", "emergency": "ROBOT_EMERGENCY_STOP"}
_FIXED = {
    "polyscopeversion": "URSoftware 5.16.0.1 (Jan 01 2024)",
    "get robot model": "UR5",
    "close safety popup": "closing safety popup",
    "close popup": "closing popup",
    "quit": "Disconnected",
}


def answer(line: str, robot: UrController) -> bytes:
    """Do what a line to the dashboard server asks of the robot, and return the answer, a line with its newline."""
    return (_answer(line.lower(), robot) + "\n").encode()


def _answer(line: str, robot: UrController) -> str:
    if line in _FIXED:
        return _FIXED[line]
    if line == "get serial number":
        return IN_LOCKSTEP if robot.options.lockstep else "20200000000"
    if line == "is in remote control":
        return str(robot.options.remote_control).lower()
    if line == "robotmode":
        return f"Robotmode: {'POWER_OFF' if robot.safety == 'emergency' else 'RUNNING'}"
    if line in ("safetymode", "safetystatus"):
        return f"{line.capitalize()}: {_MODES[robot.safety]}"
    if line == "running":
        return f"Program running: {str(robot.program is not None and not robot.paused).lower()}"
    if line == "programstate":
        return "STOPPED" if robot.program is None else "PAUSED" if robot.paused else "PLAYING"
    if line == "stop":
        robot.end_program("stopped by the dashboard")
        return "Stopped"
    if line == "unlock protective stop":
        if robot.unlock():
            return "Protective stop releasing"
        return (
            f"Cannot unlock protective stop until {robot.options.unlock_after:g}s after occurrence. "
            "Always inspect cause of protective stop before unlocking"
        )
    robot.say(f"a dashboard command is not emulated: {line}")
    return f"could not understand: '{line}'"
