"""The emulated servos on a busy machine: what a scan finds, how soon they answer, how much of a core they take.

`python benchmarks/emulator_load.py [--quick] [--json] [--busy 8] [--noise 60]`. The stand-alone emulator runs with the
wall clock. Counted are: the share of a core that it takes while it waits for a client, and with torque on; the time to
an answer after noise whose replies were not read. Then, with processes next to it that only compute: scans that find
both servos, by the maker's SDK (a broadcast ping, for which the SDK waits 0.8 s) and by `python -m
whiptool.rig.dynamixel` (1 s per servo); single pings of the SDK, which it gives up after 34 ms: on a busy machine the
client itself may not run for as long; and whether a run in lock-step is the idle machine's, bit by bit.
"""

from __future__ import annotations

import argparse
import hashlib
import io
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout, suppress
from pathlib import Path

import dynamixel_sdk as sdk
import numpy as np

from whiptool.commands.servos import main as scan_command
from whiptool.rig.emulator import Emulator, TwinOptions
from whiptool.rig.emulator.packets import Packet, encode

PING = encode(Packet(1, 1))
ASK = encode(Packet(2, 2, bytes([0, 0, 33, 0])))  # 33 bytes of servo 2: nothing in the noise asks for that
ANSWER = bytes.fromhex("FF FF FD 00 02 25 00 55")
SETTING = (3, 4, 6, 8, 0x83, 0x93)  # instructions that may change how a servo talks, or turn torque off
BUSY = "import time\nend = time.monotonic() + 300\nwhile time.monotonic() < end: pass"  # ends, whatever becomes of us


@contextmanager
def served(link: Path) -> Iterator[subprocess.Popen[str]]:
    """The stand-alone emulator, once it can be opened."""
    command = [sys.executable, "-m", "whiptool.rig.emulator", "--link", str(link)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        for _ in ("the device", "the link"):
            process.stdout.readline()
        try:
            yield process
        finally:
            process.terminate()


@contextmanager
def busy(n: int) -> Iterator[None]:
    """So many processes that only compute."""
    processes = [subprocess.Popen([sys.executable, "-c", BUSY]) for _ in range(n)]
    try:
        yield
    finally:
        for process in processes:
            process.kill()
            process.wait()


@contextmanager
def opened(link: Path) -> Iterator[tuple[sdk.PortHandler, sdk.Protocol2PacketHandler]]:
    """The SDK's own port and handler."""
    port = sdk.PortHandler(str(link))
    assert port.setBaudRate(1_000_000)
    yield port, sdk.Protocol2PacketHandler()
    port.closePort()


def set_torque(link: Path, on: int) -> None:
    """Turn torque of both servos on or off."""
    with opened(link) as (port, handler):
        for id in (1, 2):
            while handler.write1ByteTxRx(port, id, 64, on)[0] != sdk.COMM_SUCCESS:
                time.sleep(0.1)


def share_of_a_core(process: subprocess.Popen[str], seconds: float) -> float:
    """Processor time per time, of a process that is left alone."""

    def spent() -> float:
        fields = Path(f"/proc/{process.pid}/stat").read_text().rsplit(")", 1)[1].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    before, start = spent(), time.monotonic()
    time.sleep(seconds)
    return round((spent() - before) / (time.monotonic() - start), 3)


def noise(rng: np.random.Generator) -> bytes:
    """Bytes at random, whole packets of random content, or a packet with a flipped bit."""
    kind = rng.integers(3)
    data = rng.integers(0, 256, int(rng.integers(1, 200)), dtype=np.uint8).tobytes()
    if kind == 1:
        packet = Packet(int(rng.choice([1, 2, 254, 9])), int(rng.integers(256)), data[:40])
        return PING if packet.instruction in SETTING else encode(packet)
    if kind == 2:
        broken = bytearray(PING)
        broken[int(rng.integers(len(PING)))] ^= 1 << int(rng.integers(8))
        return bytes(broken)
    return data


def answer_after_noise(link: Path, seconds: float) -> dict[str, float]:
    """Send noise as fast as it is taken, and read nothing; then how long an answer takes [s], at most 10."""
    with opened(link) as (port, _):
        line, rng, sent = port.ser.fileno(), np.random.default_rng(0), 0
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            with suppress(BlockingIOError):
                sent += os.write(line, noise(rng))
        port.clearPort()
        start, asked, answer = time.monotonic(), 0, b""
        while ANSWER not in answer and time.monotonic() < start + 10:
            if asked < len(ASK):
                with suppress(BlockingIOError):
                    asked += os.write(line, ASK[asked:])
            answer += port.readPort(4096)
            time.sleep(1e-4)
        return {"noise_bytes": sent, "answer_after_noise_s": round(time.monotonic() - start, 4)}


def scans(link: Path, tries: int) -> dict[str, int]:
    """How many scans find both servos, and how many single pings are in time for the SDK."""
    with opened(link) as (port, handler):
        broadcast = sum(sorted(handler.broadcastPing(port)[0]) == [1, 2] for _ in range(tries))
        pings = 0
        for _ in range(tries):
            time.sleep(0.05)  # a late reply is not the next ping's
            pings += handler.ping(port, 1)[1] == sdk.COMM_SUCCESS
    command = 0
    for _ in range(tries):
        with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
            command += scan_command(["--port", str(link)]) == 0
    return {"tries": tries, "sdk_scans_found": broadcast, "command_scans_found": command, "sdk_pings_in_34_ms": pings}


def lockstep_digest() -> str:
    """Of a run in lock-step: a fifth of a second of an arm that is driven by changing currents."""
    with Emulator(TwinOptions(start=(0.4, 0.3))) as twin, twin.bus() as bus:
        for id in bus.ids:
            bus.write(id, "operating_mode", 0)
            bus.write(id, "goal_current", 0)
            bus.write(id, "torque_enable", 1)
        for k in range(100):
            bus.write_currents([100 - k, k - 50])
        path = twin.trajectory()
    return hashlib.sha256(b"".join(path[name].tobytes() for name in sorted(path))).hexdigest()


def measure(link: Path, *, processes: int, tries: int, seconds: float, noisy: float) -> dict[str, object]:
    """All figures, with a stand-alone emulator on `link`."""
    with served(link) as emulator:
        time.sleep(1.0)
        idle = share_of_a_core(emulator, seconds)
        set_torque(link, 1)
        driven = share_of_a_core(emulator, seconds)
        after_noise = answer_after_noise(link, noisy)
        set_torque(link, 0)
        alone = lockstep_digest()
        with busy(processes):
            found = scans(link, tries)
            repeats = lockstep_digest() == alone
    return {
        "idle_share_of_a_core": idle,
        "driven_share_of_a_core": driven,
        **after_noise,
        "busy_processes": processes,
        **found,
        "lockstep_repeats": repeats,
    }


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--busy", type=int, default=8)
    parser.add_argument("--noise", type=float, default=60.0)
    args = parser.parse_args()
    tries, seconds, noisy = (1, 0.5, 0.5) if args.quick else (20, 10.0, args.noise)
    processes = 1 if args.quick else args.busy
    with tempfile.TemporaryDirectory() as folder:
        result = measure(Path(folder) / "servos", processes=processes, tries=tries, seconds=seconds, noisy=noisy)
    print(json.dumps(result) if args.json else "\n".join(f"{name:24s} {value}" for name, value in result.items()))


if __name__ == "__main__":
    main()
