"""franka-sim's server in step with its client: run by the Python of an environment that holds it, not by the tests'.

The server's protocol and its judgement of commands are unchanged. Its physics advances by one step for each state that
it sends, and it waits for the answer so long that a busy machine loses no cycle. Commands come by standard input:
`pull` cuts the cable (no state goes out, no answer comes in), `plug` mends it.
"""

from __future__ import annotations

import logging
import os
import socket
import sys
import threading
import time
from types import SimpleNamespace

import mujoco
from franka_sim import FrankaSimServer, mujoco_franka_sim
from franka_sim.mujoco_franka_sim import MujocoFrankaSim
from franka_sim.server import state_stream

PATIENCE = 20.0  # [s] for an answer
CABLE = threading.Event()
CABLE.set()


class Socket(socket.socket):
    """A socket on the cable."""

    def sendto(self, *given) -> int:
        return super().sendto(*given) if CABLE.is_set() else 0


class Stepped(MujocoFrankaSim):
    """The robot, which moves on by 1 ms when it is told to."""

    step_lock = threading.Lock()

    def advance(self) -> None:
        with self.step_lock:
            self._apply_control()
            mujoco.mj_step(self.model, self.data)
            self._read_and_publish_state()

    def run_simulation(self) -> None:
        while self.running:
            time.sleep(0.05)


class Server(FrankaSimServer):
    """The server, which waits for an answer."""

    def _drain_gate(self, answer_deadline: float = 0.0) -> float:
        began = time.perf_counter()
        while CABLE.is_set() and self.running and self.connection_running:
            if not (self.comm.awaiting_answer or self._commands_in_flight):
                break
            if time.perf_counter() - began > PATIENCE:
                break
            time.sleep(2e-5)
        waited = super()._drain_gate(0.0)
        self.physics_sim.advance()
        return waited + time.perf_counter() - began


def main() -> None:
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(message)s")
    if sys.argv[2:]:
        mujoco_franka_sim.ARM_INITIAL_Q[:] = [float(x) for x in sys.argv[2:]]
    state_stream.socket = SimpleNamespace(**{name: getattr(socket, name) for name in dir(socket)} | {"socket": Socket})
    server = Server(host=sys.argv[1], physics_sim=Stepped(), enable_gripper=False,
                    enforce_comm_constraints=True, enforce_motion_limits=True)  # fmt: skip
    server.physics_sim.initialize_simulation()
    server._bind_listener()
    server.physics_sim.running = True
    threading.Thread(target=server.run_server, daemon=True).start()
    print("ready", flush=True)
    for line in sys.stdin:
        (CABLE.clear if line.strip() == "pull" else CABLE.set)()
        print("done", flush=True)
    os._exit(0)  # its threads have nothing to write


if __name__ == "__main__":
    main()
