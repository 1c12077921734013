"""Emulated hardware: `python -m whiptool.rig.emulator` emulates servos on a pseudo-terminal, for any client of Protocol
2.0, and `python -m whiptool.rig.ur_emulator` a UR5e, for any client of RTDE and for ur_rtde.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, ClassVar

from whiptool.commands import cli
from whiptool.commands.options.model_options import ModelOptions
from whiptool.commands.options.option_group import Conditions, OptionGroup, renaming, when, whole
from whiptool.commands.servos import Baud
from whiptool.models.numbers import number

if TYPE_CHECKING:
    from whiptool.rig.emulator.faults import Fault

_SERVOS = "Emulated servos on a pseudo-terminal, for any program that speaks Protocol 2.0."
_UR = "An emulated UR5e: dashboard, programs of ur_rtde, and RTDE, on an address of this machine."


@dataclass(frozen=True, kw_only=True)
class EmulatorOptions(ModelOptions):
    """Options of `python -m whiptool.rig.emulator`, which emulates servos on a pseudo-terminal."""

    only_with: ClassVar[Conditions] = {"period": when("lockstep")}
    first: ClassVar[tuple[str, ...]] = ("baud", "friction", "lockstep", "link", "faults")

    baud: Baud = 1_000_000
    """Baud rate of the emulated servos."""
    friction: bool = True
    """Emulate the friction and the rotor inertia of real servos."""
    lockstep: bool = False
    """Advance the time with every write of Goal Current instead of with the wall clock."""
    period: float = 0.002
    """Control period in lock-step [s]."""
    link: str | None = None
    """Make a symbolic link with this name to the device."""
    reboot_time: float | None = None
    """Time for which a servo does not answer after a reboot [s]; default: 0.4, and 0 in lock-step."""
    faults: tuple[str, ...] = ()
    """Faults that happen, such as drop:at=2:count=10 (from 2 s on ten replies are lost). Each is KIND:NAME=NUMBER:..,
    further examples are sag:at=2:volts=8:lasting=0.5 and same_id:servo=1. All kinds take at [s]. Kinds of the line are
    drop, late, duplicate, lose (count: packets), corrupt, split (count, seed), unplug; those of servos are dead, hot,
    stuck, flicker, alert, reboot, same_id (servo: from 0), jump (servo, angle: -6.28 to 6.28 rad, lasting [s]) and sag
    (volts: 0.1 to 24, lasting)."""

    def check(self) -> None:
        super().check()
        _faults(self)


def _faults(o: EmulatorOptions) -> list[Fault]:
    from whiptool.rig.emulator.faults import Fault

    with renaming({"fault": "--faults"}):
        return [Fault.parse(text) for text in o.faults]


def _serve_servos(o: EmulatorOptions) -> int:
    from whiptool.rig.emulator.motor import HARDWARE, Motor
    from whiptool.rig.emulator.physics import TwinOptions
    from whiptool.rig.emulator.serving import serve_alone

    options = TwinOptions(
        o.build_model(),
        HARDWARE if o.friction else Motor(),
        lockstep=o.lockstep,
        period=o.period,
        baud=o.baud,
        reboot_time=o.reboot_time,
    )
    serve_alone(options, o.link, _faults(o))
    return 0


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
    """Periods of 2 ms from sending a command until the robot reports its effect, which begins one period earlier."""
    protective_stop: float | None = None
    """Make a protective stop so long after the arm began to follow commands of servoJ [s]."""
    emergency_stop: float | None = None
    """Press the emergency stop, likewise [s]."""
    cable_pulled: float | None = None
    """Pull the network's cable, likewise [s]."""
    lockstep: bool = False
    """Let time wait for the client's next command while the arm follows servoJ, so that a busy computer disturbs no
    strike; a real controller does not wait."""

    def check(self) -> None:
        super().check()
        number("--elbow-speed", self.elbow_speed, low=0, strict=True)
        number("--tool-speed", self.tool_speed, low=0, strict=True)
        whole("--command-delay", self.command_delay, low=1, high=50)
        for name in ("protective_stop", "emergency_stop", "cable_pulled"):
            if getattr(self, name) is not None:
                number("--" + name.replace("_", "-"), getattr(self, name), low=0)


def _serve_ur(o: UrEmulatorOptions) -> int:
    from whiptool.rig.ur_emulator.ur_controller import HOME, UrFault, UrOptions
    from whiptool.rig.ur_emulator.ur_server import UrServer

    posture, limits = o.posture or HOME, {"elbow_speed": o.elbow_speed, "tool_speed": o.tool_speed}
    server = UrServer(UrOptions(o.host, posture, o.command_delay, lockstep=o.lockstep, **limits))
    server.robot.on_log = lambda sentence: print(sentence, flush=True)
    for kind, at in (("protective", o.protective_stop), ("emergency", o.emergency_stop), ("silence", o.cable_pulled)):
        if at is not None:
            server.robot.add(UrFault(kind, at))
    print(f"an emulated UR5e serves on {o.host}: ur://{o.host}; Ctrl-C ends it", flush=True)
    try:
        server.serve()
    except KeyboardInterrupt:
        server.close()
    return 0


def _emulator(
    options: type[OptionGroup], name: str, about: str, run: Callable[..., int], server: str
) -> Callable[[Sequence[str] | None], int]:
    """Return the command line of an emulator.

    Args:
        options, name, about, run: As for `cli.command`.
        server: Module whose `serve_child` serves instead for `whiptool.rig.child_process.Emulated`, which starts
            `python -m whiptool.NAME --control FD`.
    """
    alone = cli.command(options, name, about, run, prog=f"python -m whiptool.{name}")

    def main(args: Sequence[str] | None = None) -> int:
        """Run the command line of the emulator; return the exit status."""
        words = list(sys.argv[1:] if args is None else args)
        if words[:1] != ["--control"]:
            return alone(words)
        import_module(server).serve_child(int(words[1]))
        return 0

    return main


servos = _emulator(EmulatorOptions, "rig.emulator", _SERVOS, _serve_servos, "whiptool.rig.emulator.serving")
ur = _emulator(UrEmulatorOptions, "rig.ur_emulator", _UR, _serve_ur, "whiptool.rig.ur_emulator.ur_server")
