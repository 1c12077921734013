"""Result of a strike on a rig: its cycles, its recording for identification, and the miss distance."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from whiptool.errors import InputError
from whiptool.goals.target import Target
from whiptool.models.joint_trajectory import JointTrajectory
from whiptool.models.kinematics import joint_points
from whiptool.models.parameters import Model
from whiptool.models.strike import T_STAY, Strike
from whiptool.models.trajectory import Approach, Trajectory
from whiptool.recording.filmed_approach import (
    Frames,
    Judgement,
    approach_seen,
    frames_of,
    judge_frames,
    tip_seen,
    unseen_around,
)
from whiptool.recording.strike_recording import ENCODERS, StrikeRecording
from whiptool.rig.cyclelog import Cycles, Phase
from whiptool.rig.stops import SafetyError, StrikeInterrupted, StrikeStopped
from whiptool.stop_signals import StopSignals


@dataclass(frozen=True)
class Run:
    """Result of a strike on the rig.

    Args:
        cycles: Log of all control cycles.
        fault: Fault that ended the run early, or signal that came, also after the last cycle; None: neither.
        torque_off: Whether every servo confirmed that its torque is off; None: the arm has its own controller,
            which holds it.
        missed: Number of cycles without a sample; of a robot with a controller: of states missing by its clock.
        overruns: Number of cycles that ended too late; None: a robot's controller keeps its own cycles.
        torque: State of the motors as text: torque is off, or the power has to be cut.
    """

    cycles: Cycles
    fault: SafetyError | None
    torque_off: bool | None
    missed: int
    overruns: int | None
    torque: str


@dataclass(frozen=True, eq=False)
class Attempt:
    """What a rig needs to make one strike.

    Args:
        strike: The strike.
        log: File for the control cycles; None: they are kept in memory.
        believed: The posterior mean of whip and arm, with which the strike is simulated before; None: the rig's model.
        signals: Signals that stop the arm.
        on_cycle: Called in every cycle with its number and phase.
    """

    strike: Strike
    log: Path | None
    believed: Model | None
    signals: StopSignals
    on_cycle: Callable[[int, Phase], None]


@dataclass(frozen=True, eq=False)
class Motion:
    """What an arm is about to do in a strike, from where it stands, as a person is asked to confirm it.

    Args:
        strike: The strike.
        port: Name or address of the arm.
        joint: Name of the joint that moves farthest.
        reach: Difference of that joint's largest and smallest position [rad].
        duration: Time until the arm is to rest [s].
        unchecked: What was not checked, in words.
        trajectory: Commanded positions of the joints, where they are planned as a whole.
    """

    strike: Strike
    port: str
    joint: str
    reach: float
    duration: float
    unchecked: tuple[str, ...] = ()
    trajectory: JointTrajectory | None = None


@dataclass(frozen=True)
class Struck:
    """Result of one strike on a rig.

    Args:
        run: Result of the control loop.
        recording: Recording of the joints and of the filmed tip; None if the run ended before its strike.
        truth: True motion of simulated arm and whip, with time 0 at the strike's first cycle; None for hardware.
    """

    run: Run
    recording: StrikeRecording | None
    truth: Trajectory | None = None
    _judged: dict[Target, Judgement | None] = field(default_factory=dict, init=False, repr=False, compare=False)

    def approach(self, target: np.ndarray) -> Approach:
        """Return the closest approach of the filmed tip to a target (d,) [m], as a batch of one strike.

        It is marked as diverged if the tip was not seen.
        """
        seen = None
        if self.recording is not None and self.run.fault is None and "tip" in self.recording.markers:
            seen = approach_seen(self.recording, target)
        if seen is None:
            return nothing_seen(self.run.cycles.q.shape[1], len(target))
        cycles = self.run.cycles.during(Phase.STRIKE)
        return Approach(
            distance=np.array([seen.distance]),
            time=np.array([seen.time]),
            tip=seen.place[None],
            velocity=seen.velocity[None],
            max_joint_speed=np.fmax.reduce(np.abs(cycles.v), axis=0)[None],  # of what was measured; nan: nothing was
            max_torque=np.fmax.reduce(np.abs(cycles.tau), axis=0)[None],
            diverged=np.zeros(1, bool),
        )

    def tip_seen(self) -> tuple[np.ndarray, np.ndarray]:
        """Return times (F,) [s] and positions (F, d) [m] of the tip in the frames that show it; F may be 0."""
        if self.recording is None or "tip" not in self.recording.markers:
            return np.zeros(0), np.zeros((0, 2))
        return tip_seen(self.recording, self.recording.points.shape[2])

    def judged(self, target: Target) -> Judgement | None:
        """Return the miss distance estimated from the camera's frames, with its standard error; None if the frames do
        not show the tip.

        The result is cached for each target.
        """
        if target not in self._judged:
            frames = self._frames(target)
            self._judged[target] = None if frames is None else judge_frames(frames, target)
        return self._judged[target]

    def unseen(self, target: Target) -> tuple[float, float] | None:
        """Return start and end [s] of the interval around the closest approach in which no frame shows the tip; None if
        the tip was seen there.
        """
        frames, judged = self._frames(target), self.judged(target)
        if frames is None or judged is None or judged.nearest is None:
            return None
        return unseen_around(frames, judged.nearest.time)

    def _frames(self, target: Target) -> Frames | None:
        """Return the frames that show the tip; None: too few do, or the strike ended in a fault."""
        if self.recording is None or self.run.fault is not None or "tip" not in self.recording.markers:
            return None
        return frames_of(self.recording, target)


def nothing_seen(a: int, d: int) -> Approach:
    """Return the `Approach`, as a batch of one, of a strike that was refused, ended in a fault or was not filmed.

    Args:
        a: Number of the arm's joints.
        d: Dimension of the target, 2 or 3.
    """
    nan, peaks = np.full((1, d), np.nan), np.full((1, a), np.nan)
    return Approach(np.array([np.inf]), np.zeros(1), nan, nan, peaks, peaks, np.ones(1, bool))


def carried_out(struck: Struck) -> Struck:
    """Return the result unchanged, or raise an error if a fault or signal ended the strike.

    Raises:
        StrikeInterrupted: A signal came.
        StrikeStopped: A fault ended it.
    """
    run = struck.run
    if run.fault is None:
        return struck
    if run.fault.kind == "signal":
        raise StrikeInterrupted(str(run.fault), struck, run.torque)
    raise StrikeStopped(str(run.fault), struck, run.torque)


def came_to_its_strike(run: Run) -> bool:
    """Whether the joints were measured in at least two cycles of the strike, so that they can be recorded."""
    return bool(np.isfinite(run.cycles.during(Phase.STRIKE).q).all(axis=1).sum() > 1)


ENCODER = 2 * np.pi / 4096 / np.sqrt(12)  # [rad], standard error of an angle read to one count


def build_recording(
    cycles: Cycles,
    model: Model,
    *,
    track: StrikeRecording | None = None,
    controller: dict | None = None,
    target: Sequence[float] | None = None,
    t_stay: float = T_STAY,
    source: str = "rig",
) -> StrikeRecording:
    """Return the recording of a strike: joints from the servos, markers from a camera.

    Time 0 is the first cycle of the strike by the loop's clock, or `strike_begins` of the log's description [s].

    Args:
        cycles: Cycles of the run, all phases.
        model: Model, for the lengths of the arm's links.
        track: Recording of a camera, with times relative to the strike's first cycle. None: the only markers are the
            arm's joints and the handle, computed from the encoders.
        controller: The controller as a table.
        target: Position of the target [m].
        t_stay: Time after the movement, as in the loop [s].
        source: Name of the source.

    Raises:
        InputError: The run ended before its strike.
    """
    during = cycles.during(Phase.STRIKE)
    seen = np.isfinite(during.q).all(axis=1)
    if seen.sum() < 2:
        raise InputError("run", f"{len(cycles)} cycles", "a run that reached its strike")
    begins = cycles.about.get("strike_begins", during.t[0])
    t = during.stamp[seen] - during.stamp[seen][0] + during.t[seen][0] - begins
    q = during.q[seen]
    joints: dict[str, Any] = {
        "strike": Strike.from_vector(cycles.about["strike"]) if "strike" in cycles.about else None,
        "controller": controller,
        "joints_t": t,
        "joints_q": q,
        "target": None if target is None else tuple(float(x) for x in target),
        "t_stay": t_stay,
        "source": source,
    }
    if track is not None:
        return dataclasses.replace(track, **joints)
    a = model.arm.n
    whole = np.zeros((len(q), model.coordinates))
    whole[:, :a] = q
    points = joint_points(model, whole)[:, : a + 1]  # from the first joint to the hand, (S, a + 1, d)
    markers = (*model.arm.joints[1:], "handle")
    reach = np.linalg.norm(np.diff(points[0], axis=0), axis=1).cumsum()
    far = reach > 0  # a joint at the place of the first one is known exactly
    return StrikeRecording(
        t=t,
        points=points[:, 1:][:, far],
        markers=tuple(np.array(markers)[far].tolist()),
        sigma=reach[far] * ENCODER,
        camera=ENCODERS,
        **joints,
    )
