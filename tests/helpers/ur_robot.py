"""Emulated UR5e robots of tests, each on an address of its own, and movements for them."""

from __future__ import annotations

import itertools
import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from whiptool.models.joint_trajectory import JointTrajectory
from whiptool.models.presets import preset
from whiptool.models.strike import Strike
from whiptool.rig.robots.robot import Sample
from whiptool.rig.robots.ur import UniversalRobot
from whiptool.rig.ur_emulator import UrEmulator, UrOptions
from whiptool.rig.ur_emulator.ur_controller import HOME

_count = itertools.count(1)
PATIENCE = 10.0  # [s] of the driver, long enough for a busy machine; in lock-step time waits
ARM = preset("ur5e").arm


def own_host() -> str:
    """Return an address that no other test uses, in this process or in another."""
    process = os.getpid()
    return f"127.{1 + next(_count) % 250}.{process >> 8 & 255}.{process & 255}"


@contextmanager
def emulated(**options: Any) -> Iterator[UrEmulator]:
    """An emulated robot in lock-step, unless the options say otherwise."""
    with UrEmulator(UrOptions(own_host(), **({"lockstep": True, "unlock_after": 0.5} | options))) as robot:
        yield robot


def driver(robot: UrEmulator, **options: Any) -> UniversalRobot:
    """The driver of an emulated robot."""
    return UniversalRobot(robot.host, ARM.joint_limits, **({"patience": PATIENCE} | options))


def swing(scale: float = 1.0, D: float = 0.6, start: np.ndarray | None = None) -> JointTrajectory:
    """A movement of all joints from where the robot stands, with short rests."""
    q_i = np.array(HOME) if start is None else start
    q_f = q_i + scale * np.array([0.5, 0.6, -0.7, 0.3, 0.4, 0.2])
    strike = Strike(tuple(q_i), tuple(q_f), D)
    return JointTrajectory.of_strike(
        strike, ARM.names, start=q_i.tolist(), limits=ARM.joint_limits, rest=0.1, t_stay=0.1
    )


def columns(samples: list[Sample]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times (T,), commands and measured positions (T, 6) of samples."""
    return np.array([x.t for x in samples]), np.array([x.q_d for x in samples]), np.array([x.q for x in samples])
