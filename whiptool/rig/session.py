"""Strikes on a rig, hardware or twin: move the servos, film, track, and save a recording."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack, closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from whiptool.errors import WhiptoolError
from whiptool.goals.target import Target
from whiptool.impedance.controller import Controller
from whiptool.models.parameters import Model
from whiptool.models.strike import T_STAY, AnyStrike, Strike
from whiptool.models.trajectory import Approach, Points, Trajectory, target_points
from whiptool.recording.strike_recording import StrikeRecording
from whiptool.rig.control_loop import Clock, RigLoop, StepClock, WallClock, move
from whiptool.rig.cyclelog import Phase
from whiptool.rig.dynamixel.bus import DynamixelBus
from whiptool.rig.dynamixel.joints import Joints
from whiptool.rig.emulator.physics import TwinOptions, TwinTruth
from whiptool.rig.emulator.process import Emulator
from whiptool.rig.loop_options import LoopOptions
from whiptool.rig.safety import Safety
from whiptool.rig.stops import Interlock, NotConfirmed, StrikeInterrupted, StrikeRefused, StrikeStopped
from whiptool.rig.struck import (
    Attempt,
    Motion,
    Run,
    Struck,
    build_recording,
    came_to_its_strike,
    carried_out,
    nothing_seen,
)
from whiptool.rig.virtual_film import VirtualFilm
from whiptool.rollout.completed import States, complete_trajectory
from whiptool.rollout.interface import Rollout, Strikes, joined
from whiptool.stop_signals import StopSignals
from whiptool.vision.source import Frame

CYCLES, RECORDING = "cycles.log", "recording.npz"
UNCHECKED = ("collisions", "floor")  # with servos, whose arm is a model in the plane


class Rig:
    """A rig that can make strikes: hardware, or a simulated twin.

    Args:
        model: The nominal model of whip and arm.
        controller: Controller of the strike.
        target: Position of the target [m], which images show.
        options: Settings of the control loop.
        interlock: Interlock that is set after a stop; default: a new one.
    """

    port = "twin"

    def __init__(
        self,
        model: Model,
        controller: Controller,
        *,
        target: tuple[float, ...] | None = None,
        options: LoopOptions | None = None,
        interlock: Interlock | None = None,
    ) -> None:
        self.model, self.controller, self.target = model, controller, target
        self.options, self.interlock = options or LoopOptions(), interlock or Interlock()

    def strike(self, strike: Strike, *, folder: Path | None = None, believed: Model | None = None) -> Struck:
        """Make one strike, write its records to a folder as they arise, and return its result.

        Args:
            strike: The strike to make.
            folder: Folder for the records; None: they are not written.
            believed: The posterior mean of whip and arm, which the rehearsal uses; default: the rig's model.

        Raises:
            StrikeRefused: The strike must not be made; nothing was armed.
            StrikeStopped: A fault ended the strike, which does not count as a trial. Its partial result is in the
                exception and in the folder.
            StrikeInterrupted: A signal came during the strike, with the same consequences; it is a KeyboardInterrupt.
            Locked: The arm was stopped before, and no person has released its interlock.
            InputError: Servos, bus or camera are not ready or not set up correctly.
        """
        self.interlock.check()
        with closing(StopSignals()) as signals:
            return self._strike(strike, folder, believed, signals)

    def refusal(self, strike: Strike, believed: Model | None = None) -> str | None:
        """Return why a strike would be refused, as far as that is known before it is made; None: it may be made.

        Args:
            strike: The strike.
            believed: As for `strike`.
        """
        return None

    def _strike(self, strike: Strike, folder: Path | None, believed: Model | None, signals: StopSignals) -> Struck:
        raise NotImplementedError

    def _loop(self, bus: DynamixelBus, clock: Clock) -> RigLoop:
        """Return the control loop of servos."""
        joints = Joints(bus)
        safety = Safety(joints, interlock=self.interlock)
        return RigLoop(joints, self.model, self.controller, options=self.options, clock=clock, safety=safety)

    def _looped(self, loop: RigLoop, attempt: Attempt) -> Run:
        """Make a strike with servos in a control loop."""
        a = attempt
        return loop.run(a.strike, path=a.log, on_cycle=a.on_cycle, believed=a.believed, signals=a.signals)

    def _recorded(self, run: Run, folder: Path | None, track: StrikeRecording | None = None) -> StrikeRecording:
        """The recording of a strike, written at once: without a track the joints alone."""
        from whiptool.impedance.controller import controller_to_table

        recording = build_recording(
            run.cycles,
            self.model,
            track=track,
            controller=controller_to_table(self.controller.reckoning_with(self.model)),
            target=self.target,
            t_stay=self.options.t_stay,
            source=self.port,
        )
        if folder is not None:
            recording.save(folder / RECORDING)
        return recording

    def _seen(self, struck: Struck, signals: StopSignals, look: Callable[[], StrikeRecording]) -> Struck:
        """The strike with what the camera saw of it; the joints are on record already.

        Raises:
            StrikeInterrupted: A signal came meanwhile.
        """
        try:
            with signals.interruptible():
                return dataclasses.replace(struck, recording=look())
        except KeyboardInterrupt:
            reason = f"signal: {signals.received or 'Ctrl-C'} came after the strike, before its film was looked at"
            self.interlock.trip(reason, lasting=False)
            signals.answered = True
            raise StrikeInterrupted(reason, struck, struck.run.torque) from None


class TwinRig(Rig):
    """A simulated rig: emulated servos with the real protocol in lock step, and a virtual camera.

    Args:
        model, controller: See `Rig`.
        truth: True model and motors; default: the model, ideal motors.
        camera: `d435-color` or `d435-infrared`: images are rendered and tracked; `points`: the tip's position with
            errors like those of tracked images; `none`.
        at_once: Whether the twin starts at the strike's start posture, without approach, waiting and return.
        shared: `target`, `options`, `interlock`, as `Rig` takes them.
    """

    def __init__(
        self,
        model: Model,
        controller: Controller,
        *,
        truth: TwinTruth | None = None,
        camera: str = "d435-infrared",
        at_once: bool = False,
        **shared: Any,
    ) -> None:
        super().__init__(model, controller, **shared)
        self.truth, self._at_once = truth or TwinTruth(model), at_once
        if at_once:
            self.options = dataclasses.replace(self.options, settle=0.0, go_back=False)
        rng, late = np.random.default_rng(self.truth.seed), self.truth.clock_offset
        self._film = VirtualFilm(camera, self.truth.model, rng, self.target, late)

    def _strike(self, strike: Strike, folder: Path | None, believed: Model | None, signals: StopSignals) -> Struck:
        """Strike, record the joints, and only then film: the picture takes longest, and a signal may end it."""
        truth, start = self.truth, strike.q_i if self._at_once else (0.0,) * self.model.arm.n
        delays = {"command_delay": truth.command_delay, "sample_delay": truth.sample_delay}
        options = TwinOptions(truth.model, truth.motor, start=start, period=1.0 / self.options.rate, **delays)
        began: list[float] = []
        with Emulator(options) as twin, twin.bus() as bus:

            def on_cycle(k: int, phase: Phase) -> None:
                if phase is Phase.STRIKE and not began:
                    began.append(float(twin.state()["t"]))

            log = None if folder is None else folder / CYCLES
            run = self._looped(self._loop(bus, StepClock()), Attempt(strike, log, believed, signals, on_cycle))
            moved = twin.trajectory()
        if not came_to_its_strike(run):
            return carried_out(Struck(run, None))
        keep = (moved["t"] >= began[0] - 1e-9) & (moved["t"] <= began[0] + strike.D + self.options.t_stay + 1e-9)
        t, q, v, tau = (moved[name][keep] for name in ("t", "q", "v", "torque"))
        path = complete_trajectory(truth.model, self.controller, strike, States(t - began[0], q, v, tau))
        struck = Struck(run, self._recorded(run, folder), path)
        if run.fault is None or run.fault.kind != "signal":
            struck = self._seen(struck, signals, lambda: self._recorded(run, folder, self._film.of(path, strike)))
        return carried_out(struck)


@dataclass(frozen=True)
class ServoLine:
    """A serial port with servos.

    Args:
        port: Serial device.
        ids: Ids of the servos, shoulder first; default: 1, 2, ..
        baud: Baud rate [bit/s].
    """

    port: str
    ids: tuple[int, ...] = ()
    baud: int = 1_000_000


class FilmedRig(Rig):
    """Base of rigs that a person confirms before they move, and that a camera may film.

    A camera that gives no frames is refused. If a camera is lost before the strike begins, the strike is stopped; if it
    is lost during the strike, the recorded joints are kept and the session ends.

    Args:
        model, controller: See `Rig`.
        camera: A `whiptool.vision.source.FrameSource` with times of the monotonic clock; None: no camera.
        confirm: Called before every strike with its `Motion`, once the arm is connected and nothing refuses the strike;
            if it returns False, the session ends. None: no confirmation, unless the arm was stopped.
        shared: `target`, `options`, `interlock`, as `Rig` takes them.
    """

    def __init__(
        self,
        model: Model,
        controller: Controller,
        *,
        camera: Any = None,
        confirm: Callable[[Motion], bool] | None = None,
        **shared: Any,
    ) -> None:
        super().__init__(model, controller, **shared)
        self.camera, self.confirm = camera, confirm

    def _ask(self, motion: Motion) -> None:
        """Ask a person whether the arm may move, where a person is asked."""
        if self.confirm is not None and not self.confirm(motion):
            raise NotConfirmed

    def _connected(self) -> AbstractContextManager[Any]:
        """Return the connection to the arm, which moves nothing."""
        raise NotImplementedError

    def _planned(self, arm: Any, attempt: Attempt) -> Motion:
        """Return what a connected arm would do; nothing moves.

        Raises:
            StrikeRefused: The strike must not be made.
        """
        raise NotImplementedError

    def _run(self, arm: Any, attempt: Attempt, motion: Motion) -> Run:
        """Make a planned strike with a connected arm."""
        raise NotImplementedError

    def _strike(self, strike: Strike, folder: Path | None, believed: Model | None, signals: StopSignals) -> Struck:
        """Strike and film, record the joints, and only then look at the frames, which a signal may end."""
        from whiptool.rig.filming import Filming

        with ExitStack() as stack:
            stack.enter_context(self.interlock.held())
            self.interlock.check()
            arm = stack.enter_context(self._connected())
            filming = None if self.camera is None else stack.enter_context(Filming(self.camera))
            if filming is not None:
                filming.wait()

            def on_cycle(k: int, phase: Phase) -> None:
                if filming is not None:
                    filming.during(phase is Phase.STRIKE)

            log = None if folder is None else folder / CYCLES
            attempt = Attempt(strike, log, believed, signals, on_cycle)
            motion = self._planned(arm, attempt)
            self._ask(motion)
            with self.interlock.moving():
                run = self._run(arm, attempt, motion)
            frames = [] if filming is None else filming.end()
            if filming is not None and filming.lost:
                self.interlock.trip(f"camera: {filming.lost}", torque=run.torque)
        if not came_to_its_strike(run):
            return carried_out(Struck(run, None))
        struck = Struck(run, self._recorded(run, folder))
        if run.fault is None and frames:
            struck = self._seen(struck, signals, lambda: self._recorded(run, folder, _tracked(frames, run)))
        struck = carried_out(struck)
        if filming is not None and filming.lost:
            raise StrikeStopped(f"camera: {filming.lost}; the joints were recorded", struck, run.torque)
        return struck


class HardwareRig(FilmedRig):
    """Dynamixel servos on a serial port, and a camera.

    Args:
        model, controller: See `Rig`.
        line: Serial port of the servos.
        shared: `camera`, `confirm`, `target`, `options`, `interlock`, as `FilmedRig` takes them.
    """

    def __init__(self, model: Model, controller: Controller, line: ServoLine, **shared: Any) -> None:
        super().__init__(model, controller, **shared)
        self.line, self.port = line, line.port

    def _connected(self) -> AbstractContextManager[DynamixelBus]:
        ids = self.line.ids or tuple(range(1, self.model.arm.n + 1))
        return DynamixelBus(self.port, list(ids), baud=self.line.baud)

    def _planned(self, arm: DynamixelBus, attempt: Attempt) -> Motion:
        arm.check(self.options.rate)
        loop, strike, o = self._loop(arm, WallClock()), attempt.strike, self.options
        if o.rehearse:
            loop.check(strike, attempt.believed)
        q = loop.joints.positions()
        way = move(q, np.array(strike.q_i), o.approach_speed).D
        back = move(np.array(strike.q_f), q, o.approach_speed).D if o.go_back else 0.0
        reach = np.ptp(np.array([q, strike.q_i, strike.q_f]), axis=0)
        duration = way + o.settle + strike.D + o.t_stay + back
        name = self.model.arm.names[int(reach.argmax())]
        return Motion(strike, self.port, name, float(reach.max()), duration, UNCHECKED)

    def _run(self, arm: DynamixelBus, attempt: Attempt, motion: Motion) -> Run:
        loop = self._loop(arm, WallClock())
        loop.options = dataclasses.replace(self.options, rehearse=False)  # it was, before the question
        return self._looped(loop, attempt)


def _tracked(frames: list[Frame], run: Run) -> StrikeRecording:
    """What the camera's frames show, its times on the loop's clock with 0 at the strike's first cycle."""
    from whiptool.vision.tracking import track

    found = track(frames).to_recording()
    zero = float(run.cycles.during(Phase.STRIKE).stamp[0])
    return dataclasses.replace(found, t=found.t - zero, t_points=found.t_points - zero)


class RigRollout(Rollout):
    """A rig with the interface of a simulator, for searches and learners that strike one after the other.

    Args:
        make: Function that returns the rig, hardware or twin, for the number of a strike.
        model: The nominal model, for bounds and reach.
        folder: Folder for the records, with `strike-0007` for strike 7; None: none are written.
        done: Number of strikes that a resumed run had already made.

    A strike that the rig refuses, or whose tip was not seen, has no closest approach; `Approach.lost` has the reason. A
    strike that a fault or a signal ends does not count as a trial; its exception ends the search.

    Attributes:
        struck: Result of each strike; None for a refused strike.
        refused: Reasons why strikes were refused, by number.
    """

    engine = "rig"
    one_by_one = True

    def __init__(self, make: Callable[[int], Rig], model: Model, *, folder: Path | None = None, done: int = 0) -> None:
        self.make, self.model, self.folder, self._done = make, model, folder, done
        self.timestep = 1e-3
        self.struck: list[Struck | None] = []
        self.refused: dict[int, str] = {}

    def approach(self, strikes: Strikes, target: Points, *, t_stay: float = T_STAY) -> Approach:
        """Make strikes one after the other and return their closest approaches, as `CompiledRollout.approach` does."""
        found = []
        vectors = self.vectors(strikes)
        for vector, point in zip(vectors, target_points(target, len(vectors)), strict=True):
            number, folder = self._done + len(self.struck) + 1, None
            if self.folder is not None:
                folder = self.folder / f"strike-{number:04d}"
                folder.mkdir(parents=True, exist_ok=True)  # a strike that was killed is struck again
            try:
                struck = self.make(number).strike(Strike.from_vector(vector), folder=folder)
            except StrikeRefused as refused:
                struck, self.refused[number] = None, refused.fix or str(refused)
            self.struck.append(struck)
            found.append(self._approach(struck, point))
        return joined(found, self.model.arm.n, self.model.dimension)

    def _approach(self, struck: Struck | None, target: np.ndarray) -> Approach:
        """The closest approach of one strike, with the camera's standard error."""
        judged = None if struck is None else struck.judged(Target(tuple(target)))
        if struck is None or judged is None:
            why = "refused" if struck is None else "unseen"
            nothing = nothing_seen(self.model.arm.n, len(target))
            return dataclasses.replace(nothing, error=np.array([np.nan]), lost=np.array([why]))
        near, nearest = struck.approach(target), judged.nearest
        known = {"distance": np.array([judged.miss]), "error": np.array([judged.error]), "lost": np.array([""])}
        if nearest is not None:
            known |= {"time": np.array([nearest.time]), "tip": np.array([nearest.place])}
            known |= {"velocity": np.array([nearest.velocity])}
        return dataclasses.replace(near, **known)

    def trajectory(self, strike: AnyStrike | np.ndarray, *, t_stay: float = T_STAY) -> Trajectory:
        """Make a strike on the simulated rig (twin), and return its true trajectory.

        Args:
            strike: The strike, or its vector (m,).
            t_stay: Not used: the options of the rig contain this time.

        Raises:
            WhiptoolError: The rig is hardware, whose true trajectory is unknown.
        """
        vector = self.one_vector(strike)
        struck = self.make(self._done + len(self.struck) + 1).strike(Strike.from_vector(vector))
        if struck.truth is None:
            raise WhiptoolError("a rig's whip is only seen by its camera: there is no trajectory of all joints")
        return struck.truth
