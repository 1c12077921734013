"""The controller of an arm, in joint space or in hand space (Sect. 4.2), and its control loop in NumPy."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import tomli_w

from whiptool.errors import InputError, expect
from whiptool.given_files import read_toml
from whiptool.impedance.laws import LAWS, ConstantImpedance, Law, PositionControl, constant_preset, oiac_preset
from whiptool.models.hand_space import HandPath, HandSpace
from whiptool.models.numbers import NoArray, is_row, number, numbers
from whiptool.models.parameters import AnyArm, ArmParameters, Model
from whiptool.models.spatial_arm import SpatialArm
from whiptool.models.strike import JointSpace, StrikePath, is_person
from whiptool.whole_files import write_whole

if TYPE_CHECKING:
    from whiptool.impedance.arm import Arm

SINGULAR = 0.02  # [m/rad] below which a direction of the hand counts as one in which joints cannot move it


@dataclass(frozen=True)
class HandControl:
    """Control of the hand's motion instead of the joints'.

    The law gives a force `F = K e + B de` (Eq. 2) from the hand's errors [m, m/s], and with orientation also from its
    rotation errors [rad, rad/s] (see `rotation_left`). With the hand's Jacobian J the joint torques are `J^T F` plus
    gravity compensation plus damping of the null space, `-b (1 - J^+ J) v`. With position control the joints follow the
    hand's path exactly.

    Args:
        posture: Home posture of the arm [rad or m], (a,); the arm takes the posture with the given hand pose that is
            nearest to it. Default: see `home_posture`.
        null_damping: Damping b of the null space, for every joint [N m s/rad]; only for laws that give torques.
        orientation: Whether strikes prescribe the hand's orientation, too.

    Raises:
        InputError: A number is not finite, or negative, or `orientation` is neither true nor false.
    """

    posture: tuple[float, ...] | None = None
    null_damping: float = 1.0
    orientation: bool = False

    def __post_init__(self) -> None:
        if self.posture is not None:
            angles = tuple(number(f"posture[{i}]", x) for i, x in enumerate(self.posture))
            object.__setattr__(self, "posture", angles)
        object.__setattr__(self, "null_damping", number("null_damping", self.null_damping, low=0))
        if not isinstance(self.orientation, bool):
            raise InputError("orientation", self.orientation, "true or false")


@lru_cache(maxsize=32)
def hand_space(arm: AnyArm, hand: HandControl, *, led: bool) -> HandSpace:
    """Return the space of strikes of an arm's hand; the result is cached.

    Args:
        arm: Arm in the plane or in space.
        hand: Control of the hand.
        led: Whether the joints follow the hand's path exactly (position control).

    Raises:
        InputError: The posture does not fit the arm or is singular, or the arm has too few joints for the hand's
            coordinates.
    """
    return HandSpace(arm, posture=hand.posture, orientation=hand.orientation, led=led)


def _check_inertia_known(arm: AnyArm) -> None:
    """Refuse an arm that torques move, but whose inertia is unknown."""
    if arm.weightless:
        given = f"unknown inertia of the links of {', '.join(arm.weightless)}"
        fix = "take position control (--controller position), or write an <inertial> of each link into the file"
        raise InputError("arm", given, "an arm whose links' inertia is known, where torques move it", fix)


def hand_impedance(model: Model, hand: HandControl | None = None, *, frequency: float = 3.0) -> ConstantImpedance:
    """Return the default stiffness and damping of the hand.

    In the home posture, with the whip's mass in the hand, they give the natural frequency `frequency` and critical
    damping. If only the hand's position is controlled (`hand.orientation` is false), both are multiples of the identity
    (d, d) [N/m, N s/m], computed from the largest effective mass in any direction. If its orientation is controlled,
    too, they are the hand's effective inertia matrix times w^2 and 2 w, w = 2 pi frequency; rotational entries are in N
    m/rad and N m s/rad. A single factor is not sufficient, because the inertia about the axis of the hand is very
    small.

    Args:
        model: Arm and whip.
        hand: Control of the hand; default: `HandControl()`.
        frequency: Natural frequency [Hz].

    Raises:
        InputError: The arm's inertia is unknown.
    """
    from whiptool.impedance.arm import Arm

    _check_inertia_known(model.arm)
    hand, d = hand or HandControl(), model.dimension
    kinematics = hand_space(model.arm, hand, led=False).kinematics
    q = kinematics.posture
    J = kinematics.jacobian(q)
    inertia = np.linalg.inv(J @ np.linalg.solve(Arm(model).inertia(q), J.T))  # that the hand feels
    inertia[:d, :d] += model.whip.mass * np.eye(d)
    if not hand.orientation:
        inertia = np.linalg.eigvalsh(inertia)[-1] * np.eye(d)
    omega = 2 * math.pi * frequency
    K, B = ((gain * (inertia + inertia.T) / 2).tolist() for gain in (omega**2, 2 * omega))
    return ConstantImpedance(tuple(map(tuple, K)), tuple(map(tuple, B)))


@dataclass(frozen=True)
class Controller(NoArray, instead="its parameters()"):
    """Computes torques from tracking errors (Eq. 2): an impedance law with gravity compensation (Eq. 3).

    Args:
        law: Constant or online-adaptive impedance, or position control, which takes no other argument; default:
            OIAC with the preset `table4`.
        feedforward: Add the torque that the arm without the whip needs to follow the reference, `I(q_d) ddq_d` with its
            velocity and viscous terms. Eq. 2 has no feedforward; the authors of the law use one in later work.
        torque_limit: Largest torque of every joint, or one value per joint [N m; N for a prismatic joint]; None: no
            limit.
        control_period: Period at which the torque is computed [s] and for which it is held, as on a rig; None:
            continuous.
        compensated: Masses [kg] of the links and, last, of the whip that gravity compensation (Eq. 3) assumes, (n +
            1,); None: those of the simulated model. A rig's controller has the masses of the nominal model.
        hand: Control of the hand: the law acts on the hand's errors, and strikes are in hand space. None: joint space.

    Raises:
        InputError: `law` is not a law, a number is not positive, `feedforward` is neither true nor false, or an option
            is set that position control does not have.
    """

    law: Law = field(default_factory=lambda: oiac_preset("table4"))
    feedforward: bool = False
    torque_limit: float | tuple[float, ...] | None = None
    control_period: float | None = None
    compensated: tuple[float, ...] | None = None
    hand: HandControl | None = None

    def table(self) -> dict[str, Any]:
        """Return the controller as plain data, see `controller_to_table`."""
        return controller_to_table(self)

    def __post_init__(self) -> None:
        if not isinstance(self.law, Law):
            raise InputError("law", self.law, "a law: OIAC(), ConstantImpedance() or PositionControl()")
        if not isinstance(self.feedforward, bool):
            raise InputError("feedforward", self.feedforward, "true or false")
        if self.compensated is not None:
            masses = tuple(number("compensated", m, low=0) for m in numbers("compensated", self.compensated))
            object.__setattr__(self, "compensated", masses)
        if self.control_period is not None:
            object.__setattr__(
                self, "control_period", number("control_period", self.control_period, low=0, strict=True)
            )
        limit = self.torque_limit
        if is_row(limit):
            each = (number(f"torque_limit[{i}]", x, low=0, strict=True) for i, x in enumerate(limit))
            object.__setattr__(self, "torque_limit", tuple(each))
        elif limit is not None:
            object.__setattr__(self, "torque_limit", number("torque_limit", limit, low=0, strict=True))
        if self.prescribed:
            for name in ("feedforward", "torque_limit", "control_period", "compensated"):
                if getattr(self, name) not in (None, False):
                    raise InputError(name, getattr(self, name), "only without position control")
        expect(HandControl, type(None), hand=self.hand)
        if self.hand is not None and self.feedforward:
            raise InputError("feedforward", True, "only in joint space")

    @property
    def prescribed(self) -> bool:
        """Whether the arm's joints follow the reference exactly (position control), and no torque is computed from
        errors.
        """
        return isinstance(self.law, PositionControl)

    def strike_space(self, arm: AnyArm) -> JointSpace | HandSpace:
        """Return the coordinates of strikes with this controller, joint space or hand space.

        Raises:
            InputError: The controller is in hand space, which the arm does not support.
        """
        expect(ArmParameters, SpatialArm, arm=arm)
        return JointSpace(arm) if self.hand is None else hand_space(arm, self.hand, led=self.prescribed)

    def check_fits(self, arm: AnyArm) -> None:
        """Refuse a controller that does not fit an arm.

        Raises:
            InputError: The law gives torques and the arm's inertia is unknown; or the law's matrices do not have
                one row per joint of the arm, or in hand space per coordinate of the hand; or `torque_limit` or
                `compensated` has a wrong length.
        """
        expect(ArmParameters, SpatialArm, arm=arm)
        if not self.prescribed:
            _check_inertia_known(arm)
        if isinstance(self.torque_limit, tuple) and len(self.torque_limit) != arm.n:
            raise InputError("torque_limit", self.torque_limit, f"one number, or {arm.n}, one per arm joint")
        if self.compensated is not None and len(self.compensated) != arm.n + 1:
            raise InputError("compensated", self.compensated, f"{arm.n + 1} masses: of every link and of the whip")
        sizes, space = {name: len(x) for name, x in self.law.parameters().items()}, self.strike_space(arm)
        rows = space.width // 2
        if sizes != self.law.sizes(rows):
            given = ", ".join(f"{name} of {math.isqrt(size)} rows" for name, size in sizes.items())
            fix = "give a controller file with them, or take oiac"
            each = "arm joint" if self.hand is None else "coordinate of the hand"
            raise InputError(f"controller {self.law.kind}", given, f"matrices of {rows} rows, one per {each}", fix)

    def reckoning_with(self, model: Model) -> Controller:
        """Return the same controller with gravity compensation for this model, independent of the simulated model."""
        expect(Model, model=model)
        if self.prescribed:
            return self
        return replace(self, compensated=(*model.arm.per_link("mass").tolist(), float(model.whip.mass)))

    def parameters(self) -> dict[str, float]:
        """Return all parameters by name: `law.a`, or `law.K[0]` to `law.K[3]`, row by row; `torque_limit`."""
        named: dict[str, float] = {}
        for name, values in self.law.parameters().items():
            single = self.law.sizes(2)[name] == 1  # not one for each joint
            named.update({f"law.{name}" + ("" if single else f"[{i}]"): float(x) for i, x in enumerate(values)})
        if isinstance(self.torque_limit, tuple):
            named |= {f"torque_limit[{i}]": x for i, x in enumerate(self.torque_limit)}
        elif self.torque_limit is not None:
            named["torque_limit"] = self.torque_limit
        if self.hand is not None and not self.prescribed:
            named["null_damping"] = self.hand.null_damping
        return named

    def clipped(self, tau: np.ndarray) -> np.ndarray:
        """Return torques (..., n) [N m] clipped to the torque limit."""
        if self.torque_limit is None:
            return tau
        limit = np.asarray(self.torque_limit)
        return np.clip(tau, -limit, limit)

    def bind(self, arm: Arm, strike: StrikePath) -> ControlLoop | HandControlLoop:
        """Return the control loop for one arm and one strike.

        Raises:
            InputError: The law is position control, which computes no torques.
        """
        if self.prescribed:
            raise InputError("controller", "position", "a law that gives torques: oiac, constant")
        if isinstance(strike, HandPath):
            return HandControlLoop(self, arm, strike)
        return ControlLoop(self, arm, strike)


class ControlLoop:
    """Computes the torques of one strike in joint space with NumPy and Pinocchio, for the MuJoCo simulator and for a
    rig.

    Args:
        controller: Controller with a law that gives torques.
        arm: Arm of the model without whip.
        strike: The strike, which gives the reference of the joints.
    """

    def __init__(self, controller: Controller, arm: Arm, strike: StrikePath) -> None:
        self.controller, self.arm, self.strike = controller, arm, strike

    def torque(self, t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Joint torques [N m], shape (n,), at time t [s] for measured `q` [rad] and `v` [rad/s] of shape (n,)."""
        q_d, v_d, a_d = self.strike.reference(t)
        e, de = q_d - q, v_d - v
        K, B = self.controller.law.gains(e, de)
        tau = K @ e + B @ de + self.arm.gravity_compensation(q, self.controller.compensated)  # Eq. 2
        if self.controller.feedforward:
            tau = tau + self.arm.feedforward(q_d, v_d, a_d)
        return self.controller.clipped(tau)


class HandControlLoop:
    """Computes the torques of one strike in hand space with NumPy and Pinocchio, for the MuJoCo simulator.

    Args:
        controller: Controller with a `hand`.
        arm: Arm of the model without whip.
        path: Path of the hand.
    """

    def __init__(self, controller: Controller, arm: Arm, path: HandPath) -> None:
        assert controller.hand is not None
        self.controller, self.arm, self.path = controller, arm, path
        self.null_damping = controller.hand.null_damping

    def torque(self, t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Joint torques [N m], shape (n,), at time t [s] for measured `q` [rad] and `v` [rad/s] of shape (n,)."""
        hand = self.arm.hand(q)
        J = self.path.way.kinematics.rows @ hand.jacobian
        e, de = self.path.errors(t, hand, J @ v)
        K, B = self.controller.law.gains(e, de)
        tau = J.T @ (K @ e + B @ de) + self.arm.gravity_compensation(q, self.controller.compensated)  # Eqs. 2, 3
        _, s, moving = np.linalg.svd(J, full_matrices=False)  # the hand is moved along these rows
        still = v - moving.T @ (s**2 / (s**2 + SINGULAR**2) * (moving @ v))
        return self.controller.clipped(tau - self.null_damping * still)


def default_controller(model: Model) -> Controller:
    """Return the default controller of a model.

    For an arm in the plane it is OIAC (online impedance adaptation control) with the preset `table4`, for the human arm
    `nah2023` the constant impedance that was published with it, and for every other arm in space position control,
    because robots follow their commands closely.
    """
    expect(Model, model=model)
    if model.dimension == 2:
        return Controller()
    return Controller(constant_preset("nah2023") if is_person(model.arm) else PositionControl())


_LARGEST = 1e6  # of K [N m/rad] and B [N m s/rad]: far beyond any arm
TABLE = "controller"  # name of the table in a file
_OPTIONS = tuple(f.name for f in dataclasses.fields(Controller) if f.name != "law")
_KEYS = {"law", *_OPTIONS, *(f.name for law in LAWS.values() for f in dataclasses.fields(law))}


def controller_to_table(controller: Controller) -> dict[str, Any]:
    """Return the controller as plain data: the law's name and parameters, and those options that are set."""
    numbers = dataclasses.asdict(controller.law)
    options = {name: getattr(controller, name) for name in _OPTIONS}
    table = {"law": controller.law.kind, **numbers, **options}
    return {key: _plain(value) for key, value in table.items() if value is not None}


def controller_from_table(table: Mapping[str, Any]) -> Controller:
    """Return the controller that `controller_to_table` described.

    Raises:
        InputError: The law or a key is unknown, or a value is not allowed; the key is named.
    """
    numbers = dict(table)
    law = numbers.pop("law", None)
    law = LAWS.name(law)
    options = {key: numbers.pop(key) for key in _OPTIONS if key in numbers}
    if "hand" in options:
        options["hand"] = _hand(options["hand"])
    known = [f.name for f in dataclasses.fields(LAWS[law])]
    for key in numbers:
        if key not in known:
            keys = ", ".join(("law", *known, *_OPTIONS))
            raise InputError(f"controller.{key}", numbers[key], f"one of the keys {keys}")
    try:
        return Controller(law=LAWS[law](**numbers), **options)
    except InputError as error:
        raise error.within("controller.") from None
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError("controller", str(table)[:80], "a controller's numbers", f"reason: {error}") from None


def read_controller(path: Path | str) -> Controller:
    """Return the controller in the table `[controller]` of a TOML file, such as the `config.toml` of a run folder.

    Raises:
        InputError: The file cannot be read, has no such table, or a value is not allowed.
    """
    content = read_toml(path)
    table = content.get(TABLE)
    if not isinstance(table, Mapping):
        raise InputError("controller", str(path), f"a TOML file with a table [{TABLE}]")
    for key in sorted(_KEYS & set(content)):
        raise InputError(
            f"{path}: {key}", content[key], f"{key} below the line [{TABLE}]", "above it, it has no effect"
        )
    try:
        controller = controller_from_table(table)
        _check_gains(controller.law)
    except InputError as error:
        raise error.within(f"{path}: ") from None
    return controller


def write_controller(controller: Controller, path: Path | str) -> None:
    """Write a controller as a TOML file that `read_controller` reads back the same."""
    write_whole(path, tomli_w.dumps({TABLE: controller_to_table(controller)}))


def _check_gains(law: Law) -> None:
    """Refuse gains that no arm has."""
    for name, values in law.parameters().items():
        if (np.abs(values) > _LARGEST).any():
            raise InputError(f"controller.{name}", values.tolist(), f"numbers up to {_LARGEST:g}")


def _hand(table: Any) -> HandControl:
    """Return the control of the hand that a table `[controller.hand]` holds."""
    known = [f.name for f in dataclasses.fields(HandControl)]
    if not isinstance(table, Mapping):
        raise InputError("controller.hand", table, "a table with some of " + ", ".join(known))
    for key in table:
        if key not in known:
            raise InputError(f"controller.hand.{key}", table[key], "one of the keys " + ", ".join(known))
    try:
        return HandControl(**table)
    except InputError as error:
        raise error.within("controller.hand.") from None
    except TypeError:
        raise InputError("controller.hand.posture", table["posture"], "a list of numbers") from None


def _plain(value: Any) -> Any:
    """Return tuples, also nested ones, as lists; what a hand's control holds as a table."""
    if isinstance(value, HandControl):
        return {key: _plain(x) for key, x in dataclasses.asdict(value).items() if x is not None}
    return [_plain(x) for x in value] if isinstance(value, tuple) else value
