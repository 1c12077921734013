"""`python -m whiptool.rig.ur_emulator`: an emulated UR5e, for any client of RTDE and for ur_rtde."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass

from whiptool.commands import cli
from whiptool.commands.options.option_group import OptionGroup, whole
from whiptool.models.numbers import number

_ABOUT = "An emulated UR5e: dashboard, programs of ur_rtde, and RTDE, on an address of this machine."


@dataclass(frozen=True, kw_only=True)
class UrEmulatorOptions(OptionGroup):
    """Options of `python -m whiptool.rig.ur_emulator`, which emulates a UR5e."""

    host: str = "127.0.0.2"
    """Address on which the robot serves; several serve at once on 127.0.0.2, 127.0.0.3, ..."""
    posture: tuple[float, float, float, float, float, float] | None = None
    """Joint positions at the start [rad]; default: upright."""
    elbow_speed: float = 5.0
    """Limit of the elbow's speed in the safety configuration [m/s]."""
    tool_speed: float = 5.0
    """Limit of the speed of flange and tool in the safety configuration [m/s]."""
    command_delay: int = 2
    """Periods of 2 ms from sending a command until the measured positions follow."""
    protective_stop: float | None = None
    """Make a protective stop so long after the arm began to follow commands of servoJ [s]."""
    emergency_stop: float | None = None
    """Press the emergency stop, likewise [s]."""
    cable_pulled: float | None = None
    """Pull the network's cable, likewise [s]."""

    def check(self) -> None:
        super().check()
        number("--elbow-speed", self.elbow_speed, low=0, strict=True)
        number("--tool-speed", self.tool_speed, low=0, strict=True)
        whole("--command-delay", self.command_delay, low=1, high=50)
        for name in ("protective_stop", "emergency_stop", "cable_pulled"):
            if getattr(self, name) is not None:
                number("--" + name.replace("_", "-"), getattr(self, name), low=0)


def _serve(o: UrEmulatorOptions) -> int:
    from whiptool.rig.ur_emulator.ur_controller import HOME, UrFault, UrOptions
    from whiptool.rig.ur_emulator.ur_server import UrServer

    server = UrServer(
        UrOptions(o.host, o.posture or HOME, o.command_delay, elbow_speed=o.elbow_speed, tool_speed=o.tool_speed)
    )
    for kind, at in (("protective", o.protective_stop), ("emergency", o.emergency_stop), ("silence", o.cable_pulled)):
        if at is not None:
            server.robot.add(UrFault(kind, at))
    print(f"an emulated UR5e serves on {o.host}: ur://{o.host}; Ctrl-C ends it", flush=True)
    try:
        server.serve()
    except KeyboardInterrupt:
        server.close()
        print("\n".join(server.robot.log))
    return 0


_emulator = cli.command(UrEmulatorOptions, "rig.ur_emulator", _ABOUT, _serve, prog="python -m whiptool.rig.ur_emulator")


def emulator(args: Sequence[str] | None = None) -> int:
    """Run the command line of the emulated UR; return the exit status."""
    words = list(sys.argv[1:] if args is None else args)
    if words[:1] == ["--control"]:  # started by `UrEmulator`
        from whiptool.rig.ur_emulator.ur_server import serve_child

        serve_child(int(words[1]))
        return 0
    return _emulator(words)
