"""Ways to run the server of emulated servos: as a child process, or alone until it is interrupted."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from multiprocessing.connection import Connection
from pathlib import Path

from whiptool.errors import InputError
from whiptool.rig import child_process
from whiptool.rig.emulator.faults import Fault
from whiptool.rig.emulator.physics import TwinOptions
from whiptool.rig.emulator.server import Server


def serve_child(fd: int) -> None:
    """Main function of the emulator's process; see `whiptool.rig.child_process.serve_child`."""

    def make(options: TwinOptions, control: Connection) -> tuple[str, Callable[[], None]]:
        server = Server(options, control)
        return server.port, server.serve

    child_process.serve_child(fd, make)


def serve_alone(options: TwinOptions, link: str | None, faults: Sequence[Fault] = ()) -> None:
    """Serve in the foreground until interrupted, with faults at their times since the start; `link` is the path of a
    symbolic link to create to the device.

    Raises:
        InputError: The link cannot be created, its name is taken, or a fault is of a servo that is not there.
    """
    server = Server(options)
    for fault in faults:
        fault.check_servo(len(server.servos))
        server.faults.add(fault)
    if link:
        _link(Path(link), server.port)
    try:
        print(f"emulated servos {list(options.ids)} at {options.baud} baud on {server.port}", flush=True)
        if link:
            print(f"and on {link}", flush=True)
        server.serve()
    except KeyboardInterrupt:
        pass
    finally:
        if link and Path(link).is_symlink() and Path(link).readlink() == Path(server.port):
            Path(link).unlink()


def _link(link: Path, device: str) -> None:
    """Make the link; one that an earlier emulator left, to a pseudo-terminal, is replaced, and nothing else."""
    try:
        if link.is_symlink() and link.readlink().parent == Path(device).parent:
            link.unlink()
        link.symlink_to(device)
    except FileExistsError:
        raise InputError("link", str(link), "a path that does not exist yet", "take another, or remove it") from None
    except OSError as error:
        raise InputError(
            "link", str(link), "a path at which a symbolic link can be made", f"reason: {error.strerror}"
        ) from None
