"""What strikes and films: a simulated whip whose tip is seen at a camera's rate, or a rig."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from whiptool.adaptation.twins import Twin
from whiptool.errors import InputError, expect
from whiptool.goals.target import Target, as_target
from whiptool.models.parameters import Model
from whiptool.models.strike import T_STAY, Strike
from whiptool.models.trajectory import Approach
from whiptool.recording.filmed_approach import approach_seen
from whiptool.recording.strike_recording import StrikeRecording
from whiptool.rig.session import Rig
from whiptool.rig.stops import StrikeRefused
from whiptool.rollout.compiled import CompiledRollout

_SAME = 1e-6  # [rad], [s]: two strikes are one


@dataclass(frozen=True)
class Seen:
    """Result of a strike, which a port returns.

    Args:
        recording: The filmed path of the tip; None: the tip was not seen.
        seen_miss: Miss distance along the filmed path, interpolated smoothly between frames [m]; None: unknown.
        true_miss: True miss distance, which only a simulated twin can measure [m]; None: not measured.
        fault: Reason why the strike was interrupted, which ends the session; empty: not interrupted.
        refused: Reason why the strike was refused before anything moved; empty: not refused. The session continues with
            the next strike.
    """

    recording: StrikeRecording | None
    seen_miss: float | None
    true_miss: float | None = None
    fault: str = ""
    refused: str = ""

    @property
    def carried_out(self) -> bool:
        """Whether the strike was carried out. Nothing is learned from one that was refused or interrupted."""
        return not (self.fault or self.refused)


def seen_of(
    recording: StrikeRecording, target: Sequence[float], *, true_miss: float | None = None, fault: str = ""
) -> Seen:
    """Return the result of a filmed strike: the recording, and the miss distance in its frames.

    The tip's path is interpolated smoothly between frames; gaps of more than two frames are left out, see
    `approach_seen`.

    Args:
        recording: Path of the tip; its time 0 is the start of the command.
        target: Position of the target [m].
        true_miss: True miss distance, which only a simulated twin can measure [m]; None: not measured.
        fault: Reason why the strike was interrupted; empty: not interrupted. After a fault no miss distance is
            computed.

    Raises:
        InputError: The recording has no marker `tip`, is in pixels, or in a plane although the target is in space.
    """
    _refuse_pixels(recording)
    recording.check_coordinates(len(target))
    near = approach_seen(recording, target)
    return Seen(recording, None if near is None or fault else near.distance, true_miss, fault)


class Port(Protocol):
    """Anything that makes a strike and films it: a simulated twin, a whiptool rig, or a lab's own robot."""

    def strike(self, strike: Strike, number: int, folder: Path | None, believed: Model | None = None) -> Seen:
        """Make a strike, film it, and return the result.

        Args:
            strike: The strike to make.
            number: Number of the strike, from 1; 0 is the measurement of the whip before the first strike. A simulated
                port draws the same noise for the same number.
            folder: For the port's own records; None: none are kept.
            believed: The posterior mean of whip and arm, with which a port may simulate the strike before making it.

        Returns:
            See `seen_of`; a strike that was refused is `Seen(None, None, refused="why")`, one that was interrupted
            `Seen(None, None, fault="why")`. An exception ends the session as a fault does.
        """
        ...


def checked(seen: Any, strike: Strike, number: int) -> Seen:
    """Check the result of a port, and add the strike and a source to a recording without them.

    Raises:
        InputError: `seen` is not a `Seen`, or its recording lacks the tip, is in pixels or belongs to another strike.
    """
    if not isinstance(seen, Seen):
        given = f"{type(seen).__name__} from strike {number}"
        raise InputError("port", given, "a Seen", "return whiptool.adaptation.ports.seen_of(recording, target)")
    recording = seen.recording
    if recording is None:
        return seen
    if not isinstance(recording, StrikeRecording):
        given = f"{type(recording).__name__} from strike {number}"
        raise InputError("port: recording", given, "a StrikeRecording, or None where nothing was seen")
    _refuse_pixels(recording)
    if "tip" not in recording.markers:
        raise InputError("port: markers", recording.markers, "the tip among them")
    if recording.strike is not None and not _is_same(recording.strike, strike):
        given = recording.strike.vector.tolist()
        raise InputError("port: strike of the recording", given, f"{strike.vector.tolist()}, the requested strike")
    named = f"strike {number}"
    source = recording.source if recording.source.endswith(named) else f"{recording.source or 'port'}, {named}"
    return dataclasses.replace(seen, recording=dataclasses.replace(recording, strike=strike, source=source))


def _is_same(one: Strike, other: Strike) -> bool:
    """Whether two strikes are one; of arms with different numbers of joints they are not."""
    a, b = one.vector, other.vector
    return len(a) == len(b) and np.allclose(a, b, rtol=0, atol=_SAME)


def _refuse_pixels(recording: StrikeRecording) -> None:
    """Refuse what one camera in space saw: one camera alone does not determine where the tip was."""
    if recording.view is not None:
        fix = "give the recordings of two cameras or more, or use motion capture"
        raise InputError("recording", f"{recording.source or 'one'} in pixels", "places of the tip in m", fix)


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
        """Return how the tip truly passes the target in a strike."""
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


class RigPort:
    """A rig as a port: hardware, or a simulated twin.

    Args:
        make: Returns the rig for a strike's number. A twin's noise depends on that number, so that a resumed run sees
            the same noise.
        target: Position of the target [m], (d,).
    """

    def __init__(self, make: Callable[[int], Rig], target: tuple[float, ...]) -> None:
        self._make, self.target = make, target

    def strike(self, strike: Strike, number: int, folder: Path | None, believed: Model | None = None) -> Seen:
        """Make a strike with the rig; see `Port.strike`.

        Raises:
            StrikeStopped, StrikeInterrupted, Locked: See `whiptool.rig.session.Rig.strike`; it does not count as a
                trial.
        """
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
