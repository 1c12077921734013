"""The bus of the servos, through the manufacturer's SDK, with checks that the SDK lacks."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from whiptool.errors import InputError
from whiptool.rig.dynamixel.control_table import BAUD_RATES, FIRMWARE, MODEL_NUMBER, Register, register
from whiptool.rig.dynamixel.line import BROADCAST, BusError, Line, NoReply, accept

# What is read every cycle, through one block of indirect addresses
BLOCK = (
    "torque_enable",
    "hardware_error_status",
    "bus_watchdog",
    "realtime_tick",
    "present_pwm",
    "present_current",
    "present_velocity",
    "present_position",
    "present_input_voltage",
    "present_temperature",
)
_FORMATS = {(1, False): "B", (1, True): "b", (2, False): "H", (2, True): "h", (4, False): "I", (4, True): "i"}


_STATE = f"for its state ({BLOCK[0]} to {BLOCK[-1]})"


class DynamixelBus(Line):
    """Servos on one serial port.

    The SDK's group classes are not used (they drop the error byte, return 0 for missing replies, and ignore signs), nor
    its functions such as `read1ByteTxRx` (they decode an error status without data). Every reply is checked here:
    checksum, id, error, length. Protocol 2.0 does not number its packets, so a late reply could be taken for the next
    answer. After a failure the line is therefore drained until it is quiet, and a ping is sent: replies come in order,
    and only a ping's reply has its form, so that no older reply can follow it. For the same reason a reply that is
    followed by more bytes is discarded.

    Args:
        device: Serial device, such as /dev/ttyUSB0.
        ids: Ids of the servos, in the order of the joints.
        baud: Bits per second.
        timeout: Largest time for a reply, in addition to the adapter's latency [s].
        fast: Use fast sync reads (firmware 45 and newer) for `read_block`.

    Raises:
        InputError: The port cannot be opened.
    """

    def __init__(
        self, device: str, ids: Sequence[int], *, baud: int = 1_000_000, timeout: float = 0.01, fast: bool = True
    ) -> None:
        if not ids or len(set(ids)) != len(ids) or not all(0 <= id <= 252 for id in ids):
            raise InputError("ids", list(ids), "different numbers from 0 to 252")
        super().__init__(device, ids[0], baud=baud, timeout=timeout)
        self.ids, self.fast = list(ids), fast
        registers = [register(name) for name in BLOCK]
        self._block = struct.Struct("<" + "".join(_FORMATS[r.size, r.signed] for r in registers))
        self._block_at = register("indirect_data_1").address
        self._goal = register("goal_current")

    # -- opening -------------------------------------------------------------------------------------------------

    def check(self, rate: float) -> None:
        """Refuse servos that do not answer or are not XM430-W350, and a line that is too slow for `rate` cycles per
        second.

        Raises:
            InputError: The message states the cause and the command that corrects it.
        """
        for id in self.ids:
            try:
                model, firmware = self.ping(id)
            except NoReply:
                raise self.absent(id) from None
            if model != MODEL_NUMBER:
                raise InputError(f"servo {id}", f"model {model}", f"{MODEL_NUMBER}, XM430-W350")
            if firmware < FIRMWARE:
                self.fast = False
        n, size = len(self.ids), self._block.size
        reply = 8 + n * (size + 4) if self.fast else n * (11 + size)
        delays = sum(self.read(id, "return_delay_time") for id in self.ids) * 2e-6
        check_rate(
            rate,
            device=self.device,
            baud=self.baud,
            bytes_per_cycle=(14 + n) + reply + (14 + 3 * n),
            delays=delays,
            latency=self.latency,
        )

    def absent(self, id: int) -> InputError:
        """Return the error for a servo that does not answer; it names the baud rate at which the servo does, if any."""
        for other in (r for r in sorted(BAUD_RATES.values()) if r != self.baud):
            try:
                with self._guarded():
                    known = self._port.setBaudRate(other)
                    self.drain()
                self._dirty = False  # what is still under way at another rate is not a packet at this one
                if known and self.ping(id, timeout=max(self.timeout, 0.03 + 300 / other)):
                    fix = f"python -m whiptool.rig.dynamixel --port {self.device} --baud {other} --set-baud {self.baud}"
                    return InputError("baud", self.baud, f"{other}, the rate of servo {id}", f"or change it: {fix}")
            except NoReply:
                continue
            finally:
                with self._guarded():
                    self._port.setBaudRate(self.baud)
        return InputError(f"servo {id}", "no reply at any baud rate", "a servo with power", "check id, power and cable")

    def prepare_block(self) -> None:
        """Map the indirect data registers to the registers that each cycle reads (`BLOCK`), and verify the mapping.

        Raises:
            BusError: A servo did not accept the mapping.
        """
        addresses = [r.address + i for name in BLOCK for r in [register(name)] for i in range(r.size)]
        start = register("indirect_address_1").address
        data = b"".join(a.to_bytes(2, "little") for a in addresses)
        for id in self.ids:
            self._write_bytes(id, start, data, "indirect addresses")
            if self._read_bytes(id, start, len(data), "indirect addresses") != data:
                raise BusError(f"servo {id} did not keep its indirect addresses")

    # -- one servo, one register ---------------------------------------------------------------------------------

    def ping(self, id: int, *, timeout: float | None = None) -> tuple[int, int]:
        """Return the model number and firmware version of a servo.

        Raises:
            NoReply, Unplugged: The servo does not answer.
        """
        data = self._ask([0] * 8 + [0, 0], id, 1, 3, timeout or self.timeout, asked="for a ping", refusable=False)
        return data[0] | data[1] << 8, data[2]

    def read(self, id: int, name: str) -> int:
        """Return the value of a register, with its sign.

        Raises:
            NoReply, Refused, Unplugged: The servo does not answer, or answers with an error.
        """
        r = register(name)
        return r.decode(self._read_bytes(id, r.address, r.size, name))

    def write(self, id: int, name: str, value: int) -> None:
        """Set a register, and verify that the servo accepted it.

        Raises:
            InputError: The register is read-only or does not take the value.
            NoReply, Refused, Unplugged: The servo does not answer, or answers with an error.
        """
        r = register(name)
        if not r.writable:
            raise InputError(name, value, "a register that can be written")
        self._write_bytes(id, r.address, _encode(r, value), f"{name} = {value}")

    def _read_bytes(self, id: int, address: int, length: int, what: str) -> bytes:
        packet = [0] * 8 + [*address.to_bytes(2, "little"), *length.to_bytes(2, "little"), 0, 0]
        return self._ask(packet, id, self._sdk.INST_READ, length, asked=f"for {what}")

    def _write_bytes(self, id: int, address: int, data: bytes, what: str) -> None:
        packet = [0] * 8 + [*address.to_bytes(2, "little"), *data, 0, 0]
        self._ask(packet, id, self._sdk.INST_WRITE, 0, asked=f"to set {what}")

    def instruct(self, id: int, instruction: int, parameters: bytes = b"") -> None:
        """Send an instruction whose reply has no data (reboot, factory reset, clear, reg write, action).

        Raises:
            NoReply, Refused, Unplugged: The servo does not answer, or answers with an error.
        """
        self._ask([0] * 8 + [*parameters, 0, 0], id, instruction, 0, asked=f"to carry out instruction {instruction}")

    # -- all servos, every cycle ---------------------------------------------------------------------------------

    def read_block(self) -> list[tuple[int, ...]]:
        """Return, for every servo, the values of the registers that each cycle reads (`BLOCK`), as signed counts.

        Raises:
            NoReply: A reply is missing, damaged or doubtful; the sample is lost, and the line is drained before the
                next sample.
            Refused: A servo answered with an error.
            Unplugged: The port is gone.
        """
        ids, size = self.ids, self._block.size

        def transact() -> list[tuple[int, ...]]:
            sent = self._handler.syncReadTx(self._port, self._block_at, size, ids, len(ids), self.fast)
            self._sent(sent)
            self._port.setPacketTimeoutMillis(self.timeout * 1e3)
            if self.fast:
                data = self._receive(BROADCAST, len(ids) * (size + 4) - 2, fast=True, asked=_STATE)
                # error, id and data of each; a CRC stands between them, and the last one is the packet's
                parts = [data[i : i + size + 2] for i in range(0, len(data), size + 4)]
            else:
                parts = []
                for id in ids:
                    data = self._receive(id, size + 1, fast=False, asked=_STATE)
                    parts.append(data[:1] + bytes([id]) + data[1:])
            if self._port.has_more():
                raise NoReply("more bytes than asked for")
            if [part[1] for part in parts] != ids:
                raise NoReply("a reply of another servo")
            for part in parts:
                accept(part[0], part[1], _STATE)
            return [self._block.unpack(part[2:]) for part in parts]

        return self._transaction(transact)

    def write_currents(self, counts: Sequence[int] | np.ndarray) -> None:
        """Set Goal Current of every servo, in counts, in one packet. Servos send no reply.

        Raises:
            InputError: A value does not fit its register.
            Unplugged: The port is gone.
        """
        data: list[int] = []
        for id, value in zip(self.ids, counts, strict=True):
            data += [id, *int(value).to_bytes(2, "little", signed=True)]
        self._sync_write(self._goal, data)

    def write_all(self, name: str, value: int) -> None:
        """Set a register of every servo to the same value, in one packet. Servos send no reply.

        Raises:
            Unplugged: The port is gone.
        """
        r = register(name)
        self._sync_write(r, [x for id in self.ids for x in (id, *_encode(r, value))])

    def _sync_write(self, r: Register, data: list[int]) -> None:
        def transact() -> None:
            self._sent(self._handler.syncWriteTxOnly(self._port, r.address, r.size, data, len(data)))

        self._transaction(transact, replies=False)


def _encode(r: Register, value: int) -> bytes:
    """The bytes of a value that fits the register; its finer limits are the servo's to check."""
    try:
        return int(value).to_bytes(r.size, "little", signed=r.signed)
    except OverflowError:
        raise InputError(r.name, value, f"a value that fits {r.size} byte{'s' * (r.size > 1)}") from None


def check_rate(
    rate: float, *, device: str, baud: int, bytes_per_cycle: int, delays: float = 0.0, latency: float | None = None
) -> float:
    """Return the transmission time of one control cycle [s]; refuse a rate that the line cannot support.

    Args:
        rate: Desired cycles per second [Hz].
        device: Serial device, for the command in the message.
        baud: Bits per second; a byte is ten bits.
        bytes_per_cycle: Bytes per cycle of the read, its reply, and the write.
        delays: Sum of the servos' return delays [s].
        latency: The adapter's latency timer [s], or None.

    Raises:
        InputError: A cycle takes longer than 1 / rate. The message names the change that is needed.
    """
    if not rate > 0:
        raise InputError("rate", rate, "a number > 0 Hz")
    wire = bytes_per_cycle * 10 / baud + delays
    total = wire + (latency or 0.0)
    if total <= 1 / rate:
        return total
    name = Path(device).name
    if latency is not None and latency > 1e-3 and wire + 1e-3 <= 1 / rate:
        fix = f"echo 1 | sudo tee /sys/class/tty/{name}/device/latency_timer"
        raise InputError("USB latency timer", f"{latency * 1e3:g} ms", f"at most 1 ms for {rate:g} Hz", fix)
    if delays and total - delays <= 1 / rate:
        fix = f"python -m whiptool.rig.dynamixel --port {device} --baud {baud} --set-return-delay 0"
        raise InputError(
            "return delay",
            f"{delays * 1e6:.0f} us a cycle",
            f"at most {(1 / rate - (total - delays)) * 1e6:.0f} us a cycle at {rate:g} Hz",
            f"run {fix}",
        )
    faster = next((b for b in (1_000_000, 2_000_000, 3_000_000, 4_000_000) if b > baud), None)
    fix = f"python -m whiptool.rig.dynamixel --port {device} --baud {baud} --set-baud {faster}" if faster else ""
    fits = f"{1 / total:.0f} Hz ({bytes_per_cycle} bytes a cycle at {baud} baud)"
    raise InputError("rate", f"{rate:g} Hz", f"at most {fits}", fix or "take a lower rate")
