"""A lab's own robot as a port: strikes go out as joint trajectories, recordings come back as files.

The adaptation waits by ending: begun again with its run folder, it reads what the lab has put there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from whiptool.adaptation.ports import Seen, seen_of
from whiptool.errors import WhiptoolError
from whiptool.goals.target import Target
from whiptool.models.joint_trajectory import RATE, REST, JointTrajectory
from whiptool.models.parameters import Model
from whiptool.models.strike import T_STAY, Strike
from whiptool.recording.readers import read_recording
from whiptool.recording.strike_recording import StrikeRecording

TRAJECTORY, RECORDED = "trajectory", "recorded.csv"  # the first as .csv and as .yaml


class AwaitsRecording(WhiptoolError):
    """The user's robot has to make a strike next.

    Args:
        strike: The strike to make.
        number: Its number in the run.
        trajectory: Trajectory that the robot has to run.
        recording: Path at which its recording is expected.
    """

    def __init__(self, strike: Strike, number: int, trajectory: Path, recording: Path) -> None:
        self.strike, self.number, self.trajectory, self.recording = strike, number, trajectory, recording
        super().__init__(f"run {trajectory}, and put what was recorded into {recording}")


class RobotPort:
    """A position-controlled robot that the user commands and records.

    Args:
        model: Model of its arm.
        target: Target, for the miss distance.
        rate: Samples a second of the trajectory [1/s].
        rest: Time at rest before the strike, in which the whip stops swinging [s].
        t_stay: Time after the movement's end for which the tip is still observed [s].
    """

    def __init__(
        self, model: Model, target: Target, *, rate: float = RATE, rest: float = REST, t_stay: float = T_STAY
    ) -> None:
        self.model, self.target, self.rate, self.rest, self.t_stay = model, target, rate, rest, t_stay

    def strike(self, strike: Strike, number: int, folder: Path | None, believed: Model | None = None) -> Seen:
        """Return the recording of a strike from the folder; see `Port.strike`.

        Raises:
            AwaitsRecording: The recording does not exist yet; the trajectory for the robot is in the folder.
            InputError: The recording cannot be read.
        """
        assert folder is not None
        file = folder / RECORDED
        if not file.exists():
            raise AwaitsRecording(strike, number, self._told(strike, folder), file)
        return seen_of(self.read(file, strike), self.target.position)

    def read(self, file: Path, strike: Strike) -> StrikeRecording:
        """Return the recording of a strike from a file, with the strike as its command, which the sidecar file need not
        contain.

        Raises:
            InputError: The file cannot be read.
        """
        return self._of(replace(read_recording(file), **self._about), strike)

    def read_cameras(self, files: Sequence[Path], strike: Strike, cameras: Path | None = None) -> StrikeRecording:
        """Return the recording of a strike in space, triangulated from two or more cameras; films are tracked, with
        progress on stderr.

        Args:
            files: For each camera a film or a table of pixels.
            strike: The strike's command, which the files' sidecars need not contain.
            cameras: File of the calibrated cameras; default: the one that each sidecar names.

        Raises:
            InputError: A file cannot be read, or the files are not of one strike, see
                `whiptool.vision.strike_in_space.strike_in_space`.
        """
        from whiptool.identification.gather import opened, tracked
        from whiptool.vision.strike_in_space import strike_in_space

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

    def _told(self, strike: Strike, folder: Path) -> Path:
        """Write a strike's trajectory, and return its file."""
        arm = self.model.arm
        path = JointTrajectory.of_strike(
            strike, arm.names, limits=arm.joint_limits, rate=self.rate, rest=self.rest, t_stay=self.t_stay
        )
        path.save_goal(folder / f"{TRAJECTORY}.yaml")
        path.save_csv(folder / f"{TRAJECTORY}.csv")
        return folder / f"{TRAJECTORY}.csv"
