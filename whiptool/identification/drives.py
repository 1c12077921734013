"""Drives of the whip in a recording: the command, a robot that follows it, measured joints, the pose of the hand, a
tracked handle, or a release by hand.

A drive converts a plant to the engine's input for one recording: parameters, initial state and inputs, with their
derivatives by the plant's free parameters and by the recording's unknowns.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from whiptool.dynamics.modes import stepped
from whiptool.dynamics.posture import hinge_is_free, start_derivative, start_posture
from whiptool.dynamics.structure import Structure
from whiptool.dynamics.swing import SwingStructure
from whiptool.errors import InputError
from whiptool.identification.joint_motion import JointMotion, ResolvedMotion
from whiptool.identification.motion import (
    BaseMotion,
    HandleMotion,
    LaggedReference,
    StillMotion,
    check_covers,
)
from whiptool.identification.plant import BareArm, Plant, Quantities
from whiptool.impedance.controller import Controller
from whiptool.models.joint_trajectory import hand_joints
from whiptool.models.parameters import AnyArm, Model
from whiptool.models.strike import Strike
from whiptool.recording.readers.angles import first_state
from whiptool.recording.strike_recording import StrikeRecording
from whiptool.rollout.batch import displacements
from whiptool.words import counted

ORIGIN, AT_BASE = -2, -1  # places of markers that are not at the end of a link: the shoulder, the swing's base
BEFORE = 0.05  # [s] before a robot's command from which its log is followed: it and the whip are at rest until then
MARGIN = 0.1  # [s] that a path goes on after the last reading, so that a delay can be found
_RELEASE = 0.1  # [s] through which a released whip's marker moves along a parabola


@dataclass(frozen=True)
class DriveOptions:
    """Options of a `Drive`, which moves the whip in one recording. The spacing `knots` of the knots of a prescribed
    motion's spline is by default 1.5 frames for a tracked handle, by cross-validation for joints and hand."""

    kind: str  # kind of drive, a key of `DRIVES`
    free: Sequence[str] = ()  # names of the plant's free parameters
    h: float = 1e-3  # time step [s]
    unknown_start: bool = False  # whether the initial state is unknown and fitted
    knots: float | None = None  # [s]; None: the default


@dataclass
class Packed:
    """Parameters of a plant, in the form that the compiled engine takes, and their derivatives by its m free
    parameters.

    For a prescribed motion of the base, `hanging` is the structure with which the equilibrium of the hanging whip is
    computed, its parameters, and their derivatives as in `dp`. For a pendulum, `zeros` (1 + m, n) are the angles that
    its encoders read while it hangs [rad], and in the following rows their derivatives.
    """

    p: np.ndarray  # parameters, (P,)
    dp: np.ndarray  # their derivatives, (m, P)
    hanging: tuple[Structure, np.ndarray, np.ndarray] | None = None
    turning: np.ndarray | None = None  # for a prescribed motion of the base: derivatives of the clamp's angle, (m,)
    zeros: np.ndarray | None = None


@dataclass
class Shot:
    """One recording prepared for simulation, with derivatives by D unknowns: the plant's free parameters, then this
    recording's own unknowns. The motion `u` of the base is described in `whiptool.dynamics.swing`."""

    p: np.ndarray  # parameters, (P,)
    dp: np.ndarray  # their derivatives, (D, P)
    x0: np.ndarray  # initial state: n joint angles, then n rates, (2 n,)
    dx0: np.ndarray  # its derivatives, (D, 2 n)
    u: np.ndarray | None = None  # motion of the base at I instants, (I, 7), in space (I, 21); None: not prescribed
    moving: np.ndarray | None = None  # derivatives of u by consecutive unknowns that change it, (unknowns, I, 7 or 21)
    first: int = 0  # index of the first of these unknowns
    place: np.ndarray | None = None  # position of the base [m], (I, d)
    dplace: np.ndarray | None = None  # its derivatives, (D, I, d)
    zero: np.ndarray | None = None  # angles that encoders read while the links hang [rad], (n,)
    dzero: np.ndarray | None = None  # their derivatives, (D, n)


class Drive:
    """Base class of drives: the motion or command that moves the whip in one recording."""

    structure: Structure | SwingStructure  # of the simulated system
    start: float  # time at which the simulated path begins [s]
    steps: int  # number of time steps of the simulation
    hold: int = 1  # number of time steps of one period of the controller
    ends: float  # for a command: time at which its reference ends [s]
    displacements: np.ndarray  # for a command: largest displacement of the tip per unit of each coordinate [m]
    period: float | None = None  # for which the controller holds its torque [s]; None: the controller is continuous
    unknowns: dict[str, np.ndarray]  # first guesses of the recording's own unknowns: `motion`, `lag`, `start`
    motion: BaseMotion  # prescribed for the whip's base; of drives that have unknowns besides `start`

    @property
    def of_start(self) -> np.ndarray:
        """Matrix (2 n, 2 n) whose product with the unknowns `start` is added to the initial angles [rad] and velocities
        [rad/s] of the n joints of the simulated system (prismatic joints: [m], [m/s]). This implementation returns the
        identity matrix."""
        return np.eye(len(self.unknowns["start"]))

    @property
    def packed_like(self) -> object:
        """Key that is equal for drives whose `pack` returns the same result."""
        return None

    def pack(self, plant: Plant, slopes: Sequence[Quantities]) -> Packed:
        """Return the plant's parameters for the compiled engine; `slopes` are the derivatives of `plant.quantities()`
        by each free parameter."""
        raise NotImplementedError

    def shot(self, plant: Plant, packed: Packed, unknowns: np.ndarray) -> Shot:
        """Return the input of a simulation, for packed parameters and values of this recording's own unknowns, (L,)."""
        raise NotImplementedError

    def link_of(self, marker: str) -> int | None:
        """Return the index of the link at whose end a marker is; ORIGIN for a marker at the shoulder, AT_BASE for one
        at the whip's base, None for an unknown name.
        """
        raise NotImplementedError


def _command(recording: StrikeRecording, plant: Plant, others: str) -> Strike:
    """The strike that a recording says was commanded; refused without one, or if it is of another arm."""
    strike, a = recording.commanded(f", or choose the drive {others}"), plant.model.arm.n
    if len(strike.q_i) != a:
        allowed = f"a strike of the arm's {counted(a, 'joint')}"
        raise InputError(f"{recording.called}: strike", strike.vector.tolist(), allowed)
    return strike


def unknown_markers(recording: StrikeRecording) -> InputError:
    """Return the error for a recording without a marker on the whip."""
    fix = "names are in lower case" if any(name != name.lower() for name in recording.markers) else ""
    if recording.joints_alone:
        fix = (
            "it holds the joints alone: add what cameras saw of the whip, as CSV (t, tip_x, tip_y, ...) whose sidecar "
            "names the log of the joints, as docs/your-robot.md shows"
        )
    rule = "tip or nodes of the whip among them (tip, node1, node2, ...)"
    return InputError(f"{recording.called}: markers", ", ".join(recording.markers), rule, fix)


def _numbered(marker: str, kind: str, count: int) -> int | None:
    """Index of `node1`, ...; None if it is not a marker of that kind."""
    digits = marker.removeprefix(kind)
    if digits == marker or not digits.isdigit() or not 1 <= int(digits) <= count:
        return None
    return int(digits) - 1


class CommandDrive(Drive):
    """Drive by the strike's command, with the arm and its controller simulated; the arm starts at its measured posture,
    if the recording has one.
    """

    def __init__(self, recording: StrikeRecording, plant: Plant, options: DriveOptions) -> None:
        command, h = _command(recording, plant, "joints or handle"), options.h
        if plant.controller is None:
            raise InputError(
                "controller",
                None,
                "the arm's controller, because the command drives the whip",
                "give Plant(model, controller)",
            )
        plant.controller.check_fits(plant.model.arm)
        self.structure = stepped(plant.model, plant.controller, free=_terms(options.free, plant), timestep=h)
        self.start, self.ends = 0.0, float(command.D)
        self.displacements = displacements(plant.model, self.structure.n)
        self.steps = math.ceil((_end(recording) + MARGIN) / h)
        self.period = period = plant.controller.control_period
        self.hold = 1 if period is None else round(period / h)
        if period is not None and not math.isclose(self.hold * h, period, rel_tol=1e-9):
            raise InputError("timestep", h, f"a whole fraction of the control period of {period:g} s")
        self.unknowns = {"start": np.zeros(2 * self.structure.n)} if options.unknown_start else {}
        self._strike, self._arm = command.vector, plant.model.arm
        self._sag = 0.0 if recording.sag is None else recording.sag

    def pack(self, plant: Plant, slopes: Sequence[Quantities]) -> Packed:
        assert plant.controller is not None
        assert isinstance(self.structure, Structure)
        return Packed(*_packed(self.structure, plant.model, plant.controller, slopes))

    def shot(self, plant: Plant, packed: Packed, unknowns: np.ndarray) -> Shot:
        assert isinstance(self.structure, Structure)
        S, n, m = self.structure, self.structure.n, len(packed.dp)
        p = packed.p.copy()
        p[: len(self._strike)] = self._strike  # the strike stands first
        dp = np.vstack([packed.dp, np.zeros((len(unknowns), len(p)))])
        q = start_posture(plant.model, self._strike[None, : S.n_arm] + self._sag)
        dx0 = np.zeros((len(dp), 2 * n))
        repeated = np.repeat(q, len(dp), axis=0)
        dx0[:, :n] = start_derivative(plant.model, S, repeated, np.repeat(p[None], len(dp), axis=0), dp)
        x0 = np.concatenate([q[0], np.zeros(n)])
        if len(unknowns):
            x0, dx0[m:] = x0 + unknowns, np.eye(2 * n)
        return Shot(p, dp, x0, dx0)

    def link_of(self, marker: str) -> int | None:
        arm = self._arm
        assert isinstance(self.structure, Structure)
        known = {"shoulder": ORIGIN, "handle": arm.n - 1, "tip": arm.n + self.structure.n_whip - 1}
        known |= {joint: i - 1 for i, joint in enumerate(arm.joints) if i}
        node = _numbered(marker, "node", self.structure.n_whip)
        return known.get(marker, None if node is None else arm.n + node)


class SwingDrive(Drive):
    """The whip alone on a prescribed motion of its base: measured, computed from a robot's command, or at rest."""

    _NAMES: ClassVar = {
        "length": "whip.l", "mass": "whip.m", "stiffness": "whip.k", "damping": "whip.b", "gravity": "gravity",
        "rest_angle": "whip.rest_angle", "dry_friction": "whip.dry_friction", "drag": "whip.drag",
        "cubic_stiffness": "whip.cubic_stiffness", "drag_ratio": "whip.drag_ratio",
        "friction_velocity": "whip.friction_velocity", "rest_angle_x": "whip.rest_angle_x",
        "inertia": "whip.node_inertia",
    }  # fmt: skip

    def __init__(self, recording: StrikeRecording, plant: Plant, options: DriveOptions) -> None:
        kind, free, unknown = options.kind, options.free, options.unknown_start
        self._arm, whip = plant.model.arm, plant.held.whip
        self._own_arm = kind == "hand"
        for name in free:
            if name.startswith(("arm.", "law.", "torque_limit")):
                raise InputError(
                    "free parameter",
                    name,
                    f"a parameter of the whip, because with drive {kind} the motion of its base is prescribed",
                    "or choose the drive command",
                )
        if kind in ("robot", "hand") and plant.model.dimension == 2:
            raise InputError("drive", kind, "for a model in the plane joints, handle, command or passive")
        if plant.model.dimension == 3:
            _check_in_space(kind, unknown=unknown, rods=not whip.kind.hinges)
        terms = ("rest_angle", "rest_angle_x", "dry_friction", "drag", "cubic_stiffness")
        used = {name for name in terms if whip.per_node(name).any()} | {"stiffness"}
        used |= {name for name in terms if any(name in f for f in free)}
        used |= {"drag_ratio"} if whip.drag_ratio != 1 or "whip.drag_ratio" in free else set()
        used |= {"dry_friction"} if "whip.friction_velocity" in free else set()
        if plant.profile is not None:
            used |= {name for name, f in (("rest_angle", "rest_curvature"), ("drag", "drag")) if f"profile.{f}" in free}
        used |= {"inertia"} if whip.per_node("node_inertia").any() or "whip.node_inertia" in free else set()
        self.structure = SwingStructure.of(
            n=whip.N, moving=True, point_masses=True, used=tuple(used), joints=whip.joints
        )
        make = {
            "joints": self._measured_joints,
            "robot": self._followed_command,
            "hand": self._measured_hand,
            "handle": self._tracked_handle,
            "passive": self._still,
        }[kind]
        # a whip that hangs at rest hangs from a hand at rest: the tip would keep any speed that its base begins with
        self.motion: BaseMotion = make(recording, plant, options)
        self.unknowns = {"lag" if kind == "robot" else "motion": self.motion.start}
        if kind == "passive":
            self.unknowns["start"] = np.linalg.solve(self.of_start, released(recording, plant, _hand(recording)))
        elif unknown:
            self.unknowns["start"] = np.zeros(2 * self.structure.coordinates)

    @property
    def of_start(self) -> np.ndarray:
        """Matrix (2 n, 2 n) whose product with the unknowns `start` is added to the angles and velocities with which
        the n joints of the whip begin.

        In the plane the unknowns are changes of the absolute angles of the links and of their rates. Changes of joint
        angles would be strongly correlated in the fit, because each of them moves all later links.
        """
        assert isinstance(self.structure, SwingStructure)
        n = self.structure.coordinates
        return np.eye(2 * n) if self.structure.dimension == 3 else np.kron(np.eye(2), np.eye(n) - np.eye(n, k=-1))

    def _measured_joints(self, recording: StrikeRecording, plant: Plant, options: DriveOptions) -> BaseMotion:
        if recording.joints_t is None or recording.joints_q is None:
            raise InputError(
                "recording",
                recording.called,
                "a recording with measured joint angles",
                'name their log in the sidecar, as joints = "NAME.joints.csv"; or choose the drive command or handle',
            )
        arm, t = plant.model.arm, recording.joints_t
        check_covers(f"{recording.called}: joints", t, recording.joints_q, *_span(recording))
        return self._along(recording, t, recording.joints_q, arm, options)

    def _followed_command(self, recording: StrikeRecording, plant: Plant, options: DriveOptions) -> BaseMotion:
        arm, self.start = plant.model.arm.in_space(), 0.0
        return LaggedReference(_command(recording, plant, "joints or hand"), arm, self._instants(recording, options.h))

    def _measured_hand(self, recording: StrikeRecording, plant: Plant, options: DriveOptions) -> BaseMotion:
        if recording.hand_t is None or recording.hand_pose is None:
            fix = 'name their log in the sidecar, as hand = "NAME.hand.csv"; or choose the drive joints or command'
            raise InputError("recording", recording.called, "a recording with the hand's pose", fix)
        self._arm, joints = hand_joints(recording.hand_pose)
        check_covers(f"{recording.called}: hand", recording.hand_t, joints, *_span(recording))
        return self._along(recording, recording.hand_t, joints, self._arm, options)

    def _along(
        self, recording: StrikeRecording, t: np.ndarray, q: np.ndarray, arm: AnyArm, options: DriveOptions
    ) -> BaseMotion:
        self.start = float(t[0])
        if not options.unknown_start and arm.dimension == 3:  # a robot's log holds its way to the start, too
            self.start = max(self.start, -BEFORE)
        log = JointMotion(t, q, arm, self._instants(recording, options.h), **_of_spline(options))
        return ResolvedMotion(log, np.zeros((len(log.start), 0)))  # until a fit finds out what readings can resolve

    def _tracked_handle(self, recording: StrikeRecording, plant: Plant, options: DriveOptions) -> BaseMotion:
        if "handle" not in recording.markers:
            raise InputError(
                "markers", recording.markers, "the handle among them", "or choose the drive command or joints"
            )
        if plant.held.whip.per_node("b")[0] or not hinge_is_free(plant.held):
            raise InputError(
                "whip.k[0]",
                "a spring or damper at the handle",
                "a free hinge, because only the handle's position is known",
                "give whip.k and whip.b a value per node, the first of them 0",
            )
        m = recording.markers.index("handle")
        seen = ~np.isnan(recording.points[:, m, 0])
        if seen.sum() < 4:
            raise InputError("handle", f"seen {seen.sum()} times", "seen four times or more")
        self.start = float(recording.t_points[seen, m][0])
        handle = recording.t_points[:, m], recording.points[:, m, :2], recording.sigma[:, m]
        return HandleMotion(
            *handle, self._instants(recording, options.h), joints=plant.model.arm.n, **_of_spline(options)
        )

    def _still(self, recording: StrikeRecording, plant: Plant, options: DriveOptions) -> BaseMotion:
        self.start = float(recording.t_points[recording.seen].min()) - recording.exposure / 2
        if plant.clamp is None and not hinge_is_free(plant.model):
            fix = "give the clamp's angle: --clamp on the command line, Plant(..., clamp=0.0) in Python"
            raise InputError("whip.k[0]", "a spring where the whip is held", "a free hinge, or a clamp", fix)
        return StillMotion(_hand(recording), len(self._instants(recording, options.h)), joints=plant.model.arm.n)

    def _instants(self, recording: StrikeRecording, h: float) -> np.ndarray:
        self.steps = math.ceil((_end(recording) + MARGIN - self.start) / h)
        return self.start + h * np.arange(self.steps + 2)

    @property
    def packed_like(self) -> object:
        return self._arm if self._own_arm else None

    def _held(self, plant: Plant) -> Model:
        """The model as it is held, by the hand alone where no arm was measured."""
        return replace(plant.held, arm=self._arm) if self._own_arm else plant.held

    def pack(self, plant: Plant, slopes: Sequence[Quantities]) -> Packed:
        assert isinstance(self.structure, SwingStructure)
        each = [{name: of[block] for name, block in self._NAMES.items()} for of in (plant.quantities(), *slopes)]
        p, *dp = (self.structure.pack(numbers) for numbers in each)
        controller = Controller()  # any: only the whip's weight and springs matter for how it hangs
        held = self._held(plant)
        S = Structure.of(held, controller, free=[f"whip.{name}" for name in self.structure.optional])
        of_whip = [{k: x for k, x in slope.items() if not k.startswith("arm.")} for slope in slopes]
        hanging = S, *_packed(S, held, controller, of_whip)
        turning = np.array([float(of["clamp"][0]) if "clamp" in of else 0.0 for of in slopes])
        return Packed(p, np.reshape(dp, (len(slopes), len(p))), hanging, turning)

    def shot(self, plant: Plant, packed: Packed, unknowns: np.ndarray) -> Shot:
        assert isinstance(self.structure, SwingStructure)
        n, m, a, p = self.structure.coordinates, len(packed.dp), self._arm.n, packed.p
        k = len(self.motion.start)
        moved = self.motion.at(unknowns[:k])
        dp = np.vstack([packed.dp, np.zeros((len(unknowns), len(p)))])
        x0, dx0 = np.zeros(2 * n), np.zeros((len(dp), 2 * n))
        assert packed.hanging is not None
        assert packed.turning is not None
        q_i, inputs = moved.q_i.copy(), moved.inputs.copy()
        if plant.clamp is not None:
            q_i[0] += plant.clamp
            inputs[:, 0] += plant.clamp
        held = self._held(plant)
        q = start_posture(held, q_i[None])
        x0[:n] = q[0, a:]
        S, hanging, d_hanging = packed.hanging
        changes = np.vstack([d_hanging, np.zeros((k, len(hanging)))])
        changes[m:, :a] = moved.d_q_i  # q_i stands first
        changes[:m, 0] = packed.turning
        both = np.repeat(q, m + k, axis=0), np.repeat(hanging[None], m + k, axis=0)
        dx0[: m + k, :n] = start_derivative(held, S, *both, changes)[:, a:]
        if len(unknowns) > k:
            x0, dx0[m + k :] = x0 + self.of_start @ unknowns[k:], self.of_start.T
        dplace = np.zeros((len(dp), *moved.place.shape))
        dplace[m : m + k] = moved.d_place
        d_inputs, first = moved.d_inputs, m
        if packed.turning.any():
            d_inputs, first = np.concatenate([np.zeros((m, *inputs.shape)), d_inputs]), 0
            d_inputs[:m, :, 0] = packed.turning[:, None]
        return Shot(p, dp, x0, dx0, inputs, d_inputs, first, moved.place, dplace)

    def link_of(self, marker: str) -> int | None:
        known = {"handle": AT_BASE, "tip": self.structure.n - 1}
        return known.get(marker, _numbered(marker, "node", self.structure.n))


def _of_spline(options: DriveOptions) -> dict[str, Any]:
    """Options of a motion's spline."""
    return {"knots": options.knots, "at_rest": not options.unknown_start}


def _check_in_space(kind: str, *, unknown: bool, rods: bool) -> None:
    """Refuse what is not identified in space yet."""
    if kind not in ("joints", "robot", "hand"):
        fix = "record the arm's joints, or the hand's pose"
        raise InputError("drive", kind, "for a model in space joints, robot, hand or command", fix)
    if unknown and rods:
        raise InputError(
            "free per recording",
            "start",
            "names other than start for a whip of rods",
            "record a strike that begins with the whip at rest",
        )


class FreeDrive(Drive):
    """A pendulum that swings freely from an unknown initial state."""

    def __init__(self, recording: StrikeRecording, plant: Plant, options: DriveOptions) -> None:
        model, free = plant.model, options.free
        assert isinstance(model, BareArm)
        if recording.points.shape[1] != model.arm.n:
            given, rule = f"{recording.points.shape[1]} links", f"{model.arm.n}, as many as the model has"
            raise InputError(f"{recording.called}: angles", given, rule)
        dry = any(model.dry_friction) or any("friction_velocity" in name or "dry_friction" in name for name in free)
        drag = any(model.drag) or any("drag" in name for name in free)
        used = [name for name, there in (("dry_friction", dry), ("drag", drag)) if there]
        self.structure = SwingStructure.of(n=model.arm.n, moving=False, point_masses=False, used=used)
        self.start = float(recording.t[0])
        self.steps = math.ceil((recording.t[-1] - self.start) / options.h - 1e-9)
        begun = recording.first_state
        begun = first_state(recording.t, recording.points[..., 0]) if begun is None else begun
        self._start = np.diff(begun, axis=1, prepend=0.0).ravel()  # relative, as the chain counts angles
        self.unknowns = {"start": np.zeros(2 * model.arm.n)} if options.unknown_start else {}

    def pack(self, plant: Plant, slopes: Sequence[Quantities]) -> Packed:
        assert isinstance(self.structure, SwingStructure)
        every = (plant.quantities(), *slopes)
        p, *dp = (self.structure.pack(numbers) for numbers in every)
        return Packed(p, np.reshape(dp, (len(slopes), len(p))), zeros=np.array([of["zero"] for of in every]))

    def shot(self, plant: Plant, packed: Packed, unknowns: np.ndarray) -> Shot:
        assert packed.zeros is not None
        m, n = len(packed.dp), len(self._start) // 2
        dp = np.vstack([packed.dp, np.zeros((len(unknowns), len(packed.p)))])
        zeros = np.vstack([packed.zeros, np.zeros((len(unknowns), n))])
        start = np.hstack([-np.diff(zeros, axis=1, prepend=0.0), np.zeros_like(zeros)])  # of the links, not encoders
        start[0] += self._start + (unknowns if len(unknowns) else 0)
        start[1 + m :] = np.eye(2 * n)[: len(unknowns)]
        return Shot(packed.p, dp, start[0], start[1:], zero=zeros[0], dzero=zeros[1:])

    def link_of(self, marker: str) -> int | None:
        return _numbered(marker, "link", self.structure.n)


def pieces(swing: StrikeRecording, length: float) -> list[StrikeRecording]:
    """Cut a recorded free swing into pieces of about `length` seconds; only the first keeps the measured initial state.

    A long swing of several links is chaotic, so that a fit to short pieces converges better at first.
    """
    count = max(1, round((swing.t[-1] - swing.t[0]) / length))
    ends = np.linspace(0, len(swing.t), count + 1).astype(int)
    found = []
    for first, last in itertools.pairwise(ends):
        cut = {name: getattr(swing, name)[first:last] for name in ("t", "points", "sigma", "t_points")}
        found.append(replace(swing, **cut, first_state=swing.first_state if first == 0 else None))
    return found


def farthest(recording: StrikeRecording) -> str:
    """Return the name of the marker nearest to the tip; an `InputError` if no marker is on the whip."""
    nodes = [name for name in recording.markers if name.removeprefix("node").isdigit()]
    outer = ["tip"] if "tip" in recording.markers else sorted(nodes, key=lambda name: int(name.removeprefix("node")))
    if not outer:
        raise unknown_markers(recording)
    return outer[-1]


def _hand(recording: StrikeRecording) -> np.ndarray:
    """Where a still hand is [m], (2,): in the middle of its marker `handle`'s places, else at the origin."""
    if "handle" not in recording.markers:
        return np.zeros(2)
    m = recording.markers.index("handle")
    seen = recording.seen[:, m]
    if not seen.any():
        raise InputError("handle", "never seen", "seen at least once")
    weight = recording.sigma[seen, m] ** -2
    return weight @ recording.points[seen, m, :2] / weight.sum()


def released(recording: StrikeRecording, plant: Plant, hand: np.ndarray) -> np.ndarray:
    """Return a first guess of how far a whip is from its equilibrium when the hand at (2,) [m] releases it: the angles
    [rad] of its N joints, then their velocities [rad/s], (2 N,).

    It is computed from the direction in which the hand sees the farthest marker, and from the rate of this direction. A
    whip on a free hinge is assumed to rotate about the hinge, any other whip to bend evenly.
    """
    model, direction = plant.held, plant.clamp or 0.0
    n, marker = model.whip.N, farthest(recording)
    node = n if marker == "tip" else int(marker.removeprefix("node"))
    m = recording.markers.index(marker)
    seen = np.flatnonzero(recording.seen[:, m])
    t = recording.t_points[seen, m]
    few = slice(0, max(4, int(np.searchsorted(t, t[0] + _RELEASE))))
    away = recording.points[seen, m, :2][few] - hand
    place, velocity = np.polynomial.polynomial.polyfit(t[few] - t[0], away, min(2, len(away) - 1))[:2]
    rate = (place[0] * velocity[1] - place[1] * velocity[0]) / (place @ place)
    hanging = start_posture(model, np.array([[direction, *[0.0] * (model.arm.n - 1)]]))[0, model.arm.n :]
    angles = direction + hanging[:node].cumsum()
    x, y = (model.whip.per_node("l")[:node, None] * np.stack([np.sin(angles), -np.cos(angles)], 1)).sum(axis=0)
    turn = math.remainder(math.atan2(place[0], -place[1]) - math.atan2(x, -y), 2 * math.pi)
    shape = np.zeros(n)
    shape[:node] = np.eye(1, node)[0] if hinge_is_free(model) else 2 / (node + 1)
    return np.concatenate([turn * shape, rate * shape])


def _span(recording: StrikeRecording) -> tuple[float, float]:
    """Times of the first and the last reading [s]."""
    times = recording.t_points[recording.seen]
    return float(times.min()), float(times.max())


def _end(recording: StrikeRecording) -> float:
    seen = recording.seen
    return float(recording.t_points[seen].max()) + recording.exposure / 2


def _packed(
    S: Structure, model: Model, controller: Controller, slopes: Sequence[Quantities]
) -> tuple[np.ndarray, np.ndarray]:
    """Parameters (P,) of the closed loop, the strike's zero, and their changes (m, P)."""
    p = S.pack(model, controller, np.zeros((1, 2 * S.n_arm + 1)))[0]
    dp = np.zeros((len(slopes), len(p)))
    for block in S.layout:
        columns = S.columns(block)
        for row, slope in zip(dp, slopes, strict=True):
            if block in slope:
                row[columns] = slope[block]
    return p, dp


def _terms(free: Sequence[str], plant: Plant) -> list[str]:
    """Names under which the closed loop knows the terms that these free numbers need."""
    if plant.profile is None:
        return list(free)
    terms = ["whip.hinge_mass", *(name for name in free if not name.startswith("profile."))]
    terms += ["whip.rest_angle"] if "profile.rest_curvature" in free else []
    return terms + (["whip.drag"] if "profile.drag" in free else [])


DRIVES: dict[str, type[CommandDrive | SwingDrive | FreeDrive]] = {
    "command": CommandDrive,
    **dict.fromkeys(("joints", "robot", "hand", "handle", "passive"), SwingDrive),
    "free": FreeDrive,
}


def make_drive(recording: StrikeRecording, plant: Plant, options: DriveOptions) -> Drive:
    """Return the drive of a recording; an `InputError` if the recording or the plant lacks data that it needs."""
    kind, bare = options.kind, isinstance(plant.model, BareArm)
    if kind not in DRIVES:
        raise InputError("drive", kind, ", ".join(DRIVES))
    if kind == "free" and not (bare and recording.angular):
        raise InputError("drive", kind, "another drive, because free takes angles of an arm without a whip")
    if kind != "free" and bare:
        raise InputError("drive", kind, "for an arm without a whip only free")
    try:
        return DRIVES[kind](recording, plant, options)
    except InputError as error:
        raise (error if recording.source in str(error) else error.within(f"{recording.source}: ")) from None
