"""The rig: servos on a bus, an emulator of them, cameras, tracking, safety, the control loop."""

from __future__ import annotations

from collections.abc import Sequence


def main(args: Sequence[str] | None = None) -> int:
    """`whiptool rig`; see `whiptool.rig.command`."""
    from whiptool.rig.command import main as command

    return command(args)
