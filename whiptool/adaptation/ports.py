"""Ports, which strike and film: a simulated whip whose tip is measured at a camera's rate, a rig, or a user's robot.

For a user's robot, strikes are written as joint trajectories, and recordings are read from files. The adaptation ends
after it has written a trajectory; when it is resumed, it reads the recording from the run folder.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from whiptool.adaptation.steps import Seen, seen_of
from whiptool.adaptation.twins import Twin
from whiptool.errors import InputError, WhiptoolError, expect
from whiptool.goals.target import Target, as_target
from whiptool.limits.all_limits import default_limits
from whiptool.limits.limits import Limits
from whiptool.limits.robot_trajectory import Execution
from whiptool.models.joint_trajectory import JointTrajectory
from whiptool.models.parameters import Model
from whiptool.models.strike import T_STAY, Strike
from whiptool.models.trajectory import Approach
from whiptool.recording.readers import read_recording
from whiptool.recording.strike_recording import StrikeRecording
from whiptool.rig.emulator.motor import HARDWARE, Motor
from whiptool.rig.emulator.physics import TwinTruth
from whiptool.rig.session import RECORDING, Rig
from whiptool.rig.stops import StrikeRefused
from whiptool.rollout.compiled import CompiledRollout


class TipPort:
    """A simulated arm and whip without servos and images, whose tip is measured `fps` times a second with normal
    errors.

    Args:
        twin: The simulated arm and unknown whip.
        target: Target, a `Target` or its position [m].
        fps: Frames per second [1/s].
        t_stay: Time after the movement's end for which the tip is still observed [s].

    Raises:
        InputError: The target is in the plane and the twin in space, or the reverse.
    """

    def __init__(
        self,
        twin: Twin,
        target: Target | Sequence[float],
        *,
        fps: float = 60.0,
        t_stay: float = T_STAY,
    ) -> None:
        expect(Twin, twin=twin)
        at = as_target(target)
        at.check_fits(twin.model)
        self.twin, self.target, self.fps, self.t_stay = twin, at.position, fps, t_stay
        self._rollout = CompiledRollout(twin.model, twin.controller)

    def passes(self, strike: Strike) -> Approach:
        """Return the true closest approach of the tip to the target in a strike."""
        return self._rollout.approach(strike.vector[None], np.array(self.target), t_stay=self.t_stay)

    def path(self, strike: Strike) -> tuple[np.ndarray, np.ndarray]:
        """Return times (T,) [s] and the tip's true path (T, d) [m], a thousand times a second."""
        t, paths, _ = self._rollout.tip_path(strike.vector[None], t_stay=self.t_stay, rate=1000.0)
        whole = np.isfinite(paths[0]).all(axis=1)
        return t[whole], paths[0, whole]

    def strike(self, strike: Strike, number: int, folder: Path | None, believed: Model | None = None) -> Seen:
        """Simulate the strike, and return the result; see `Port.strike`."""
        near = self.passes(strike)
        if near.diverged[0]:
            return Seen(None, None, refused="the simulated whip diverged")
        fine, path = self.path(strike)
        t = np.arange(int(fine[-1] * self.fps) + 1) / self.fps
        rng = np.random.default_rng([self.twin.seed, number])
        points = np.stack([np.interp(t, fine, x) for x in path.T], axis=1)
        points += self.twin.noise * rng.standard_normal(points.shape)
        recording = StrikeRecording(
            t=t + self.twin.clock_offset,
            points=points[:, None],
            markers=("tip",),
            sigma=np.full((1, 1), self.twin.noise),
            strike=strike,
            target=self.target,
            t_stay=self.t_stay,
            source=f"{self.twin.family}-{self.twin.seed}, strike {number}",
        )
        return seen_of(recording, self.target, true_miss=float(near.distance[0]))


def truth_of(twin: Twin, motor: Motor = HARDWARE) -> TwinTruth:
    """Return the true parameters of a twin with these motors, as a simulated rig takes them."""
    delay = twin.latency / 2
    return TwinTruth(twin.model, motor, command_delay=delay, sample_delay=delay, clock_offset=twin.clock_offset)


class RigPort:
    """A rig as a port: hardware, or a simulated twin, with a target at a position (d,) [m].

    `make` returns the rig for a strike's number, on which a twin's noise depends, so that a resumed run sees the same
    noise.
    """

    def __init__(self, make: Callable[[int], Rig], target: tuple[float, ...]) -> None:
        self._make, self.target = make, target
        self._judge: Rig | None = None  # since the last strike

    def refusal(self, strike: Strike, believed: Model | None = None) -> str | None:
        """Return why the rig would refuse a strike from where its arm stands now; see `Port.refusal`."""
        self._judge = self._judge or self._make(0)
        return self._judge.refusal(strike, believed)

    def strike(self, strike: Strike, number: int, folder: Path | None, believed: Model | None = None) -> Seen:
        """Make a strike with the rig, see `Port.strike`; one that is stopped or interrupted raises, see `Rig.strike`,
        and does not count.
        """
        self._judge = None
        try:
            struck = self._make(number).strike(strike, folder=folder, believed=believed)
        except StrikeRefused as error:
            return Seen(None, None, refused=error.fix or str(error))
        place = np.array(self.target)
        near = struck.approach(place)
        seen = float(near.distance[0]) if np.isfinite(near.distance[0]) else None
        true = None if struck.truth is None else float(struck.truth.approach(place).distance[0])
        recording = struck.recording
        if recording is not None and "tip" not in recording.markers:
            recording = None
        if recording is not None:
            recording = dataclasses.replace(recording, source=f"{recording.source}, strike {number}")
        return Seen(recording, seen, true)


TRAJECTORY, RECORDED = "trajectory", "recorded.csv"  # the first as .csv and as .yaml


class AwaitsRecording(WhiptoolError):
    """Raised if the user's robot has to make the next strike.

    Args:
        strike: The strike to make.
        number: Number of the strike in the run.
        trajectory: Trajectory that the robot has to run.
        recording: Path at which the recording of the strike is expected.
    """

    def __init__(self, strike: Strike, number: int, trajectory: Path, recording: Path) -> None:
        self.strike, self.number, self.trajectory, self.recording = strike, number, trajectory, recording
        if trajectory.name == RECORDING:
            super().__init__(f"the robot made the strike, see {trajectory}; put what your cameras saw into {recording}")
        else:
            super().__init__(f"run {trajectory}, and put what was recorded into {recording}")


class RobotPort:
    """A position-controlled robot with a whip, which makes the strikes itself if `rig` is given; else the user's own
    program commands and records it.

    Strikes are executed as `execution` says, by default from a robot that stands at each strike's start; the tip is
    observed for `t_stay` [s] after the movement's end.
    """

    must_teach = True  # a recording of which nothing can be learned is refused: the lab can mend its file

    def __init__(
        self,
        model: Model,
        target: Target,
        *,
        execution: Execution | None = None,
        t_stay: float = T_STAY,
        rig: Rig | None = None,
    ) -> None:
        self.model, self.target, self.t_stay = model, target, t_stay
        self.execution, self.rig = Execution() if execution is None else execution, rig

    def refusal(self, strike: Strike, believed: Model | None = None) -> str | None:
        """Return why a strike would be refused from where the robot stands; see `Port.refusal`."""
        return self.rig.refusal(strike, believed) if self.rig is not None else self._planned(strike, believed)[1]

    def strike(self, strike: Strike, number: int, folder: Path | None, believed: Model | None = None) -> Seen:
        """Return the recording of a strike from the folder, see `Port.strike`; until it exists, write the trajectory
        for the robot there and raise `AwaitsRecording`.
        """
        assert folder is not None
        file = folder / RECORDED
        if file.exists():
            return seen_of(self.read(file, strike), self.target.position)
        moved = folder / RECORDING
        try:
            if self.rig is None:
                moved = self._told(strike, folder, believed)
            elif not moved.exists():
                self.rig.strike(strike, folder=folder, believed=believed)
        except StrikeRefused as error:
            return Seen(None, None, refused=error.fix or str(error))
        raise AwaitsRecording(strike, number, moved, file)

    def read(self, file: Path, strike: Strike) -> StrikeRecording:
        """Return the recording of a strike from a file, with the strike as its command, which the sidecar file need not
        contain.
        """
        found, moved = replace(read_recording(file), **self._about), file.with_name(RECORDING)
        if found.joints_q is None and moved.exists():  # the robot's own log
            log = StrikeRecording.load(moved)
            found = replace(found, joints_t=log.joints_t, joints_q=log.joints_q)
        return self._of(found, strike)

    def read_cameras(self, files: Sequence[Path], strike: Strike, cameras: Path | None = None) -> StrikeRecording:
        """Return the recording of a strike in space, triangulated from a film or table of pixels of each of two or more
        cameras, calibrated in the file `cameras` (default: as each sidecar names). Films are tracked, with progress on
        stderr.
        """
        from whiptool.identification.inputs import opened, tracked
        from whiptool.vision.multi_view import strike_in_space

        found = [opened(str(file), cameras=cameras) for file in files]
        views = [tracked(one, name=file.name)[0] for one, file in zip(found, files, strict=True)]
        return self._of(strike_in_space([replace(view, **self._about) for view in views]), strike)

    def _of(self, recording: StrikeRecording, strike: Strike) -> StrikeRecording:
        """The recording with its strike, where it states none, and joints and axes as the model has them."""
        named = recording if recording.strike is not None else replace(recording, strike=strike)
        return named.for_model(self.model)

    @property
    def _about(self) -> dict[str, Any]:
        return {"t_stay": self.t_stay, "target": list(self.target.position)}

    def _planned(
        self, strike: Strike, believed: Model | None, execution: Execution | None = None
    ) -> tuple[JointTrajectory, str | None]:
        """The trajectory of a strike, and what it exceeds."""
        how = execution or self.execution
        return how.judged(believed or self.model, strike, self.t_stay, self._limits)

    @cached_property
    def _limits(self) -> list[Limits]:
        """The limits that strikes have to keep."""
        return default_limits(self.model, prescribed=True)

    def _told(self, strike: Strike, folder: Path, believed: Model | None) -> Path:
        """Write a strike's trajectory, and return its file; raise StrikeRefused if the strike exceeds the limits."""
        path, beyond = self._planned(strike, believed)
        if beyond is not None:
            of_strike, at_start = beyond, replace(self.execution, posture=None)
            if self.execution.posture is not None:
                of_strike = self._planned(strike, believed, at_start)[1]
            if of_strike is not None:
                raise StrikeRefused("strike", strike.vector.tolist(), "a strike within the limits", of_strike)
            rule = "a posture from which a straight line of the joints leads to the strike's start within the limits"
            raise InputError("posture", self.execution.posture, f"{rule}; {beyond}")
        path.save_goal(folder / f"{TRAJECTORY}.yaml")
        path.save_csv(folder / f"{TRAJECTORY}.csv")
        return folder / f"{TRAJECTORY}.csv"
