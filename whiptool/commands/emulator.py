"""Emulated servos on a pseudo-terminal, for any client of Protocol 2.0: `python -m whiptool.rig.emulator`."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

from whiptool.commands import cli
from whiptool.commands.dynamixel import Baud
from whiptool.commands.options.option_group import Conditions, when
from whiptool.commands.options.target_options import ModelOptions


@dataclass(frozen=True, kw_only=True)
class EmulatorOptions(ModelOptions):
    """Emulated servos on a pseudo-terminal."""

    only_with: ClassVar[Conditions] = {"period": when("lockstep")}

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


def _serve(o: EmulatorOptions) -> int:
    from whiptool.rig.emulator.motor import HARDWARE, Motor
    from whiptool.rig.emulator.process import serve_alone
    from whiptool.rig.emulator.twin_options import TwinOptions

    motor = HARDWARE if o.friction else Motor()
    serve_alone(TwinOptions(o.build_model(), motor, lockstep=o.lockstep, period=o.period, baud=o.baud), o.link)
    return 0


_command = cli.command(EmulatorOptions, "rig.emulator", __doc__ or "", _serve, prog="python -m whiptool.rig.emulator")


def main(args: Sequence[str] | None = None) -> int:
    """Run the command line, and return the exit status."""
    words = list(sys.argv[1:] if args is None else args)
    if words[:1] == ["--control"]:  # started by `Emulator`
        from whiptool.rig.emulator.process import serve_child

        serve_child(int(words[1]))
        return 0
    return _command(words)
