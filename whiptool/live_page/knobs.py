"""Numbers of whip, controller and strike that sliders change, with their units and ranges."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from whiptool.errors import InputError
from whiptool.impedance import CONSTANT_PRESETS, LAWS, ConstantImpedance, constant_preset, oiac_preset
from whiptool.impedance.controller import Controller
from whiptool.impedance.laws import Law
from whiptool.models.parameters import Model
from whiptool.models.profile import lumped_from
from whiptool.models.strike import StrikeBounds, sliding_names, strike_names
from whiptool.models.whip import WhipParameters

DRAG = 0.005  # [N s^2/m^2], of a node, up to which the slider goes for a whip without drag
_SHORT = 5  # characters of a name that has room in front of what it means
_STEPS = 2000  # of a slider, about
_SAME = 1e-4  # relative difference of tapers that are the same, after rounding to a slider's steps


@dataclass(frozen=True)
class Knob:
    """A number that a slider changes.

    Args:
        name: Name, such as `whip.k`.
        label: Symbol and meaning.
        unit: Unit; empty: none.
        low, high: Range of the slider.
        value: Present value.
    """

    name: str
    label: str
    unit: str
    low: float
    high: float
    value: float

    @property
    def text(self) -> str:
        """Label with the unit."""
        return f"{self.label} [{self.unit}]" if self.unit else self.label

    @property
    def step(self) -> float:
        """Step of the slider: a power of ten, some thousandths of its range."""
        return float(10.0 ** math.floor(math.log10((self.high - self.low) / _STEPS)))

    def around(self, value: float) -> Knob:
        """Return the knob at another value, with a range that contains it."""
        return replace(self, value=value, low=min(self.low, value), high=max(self.high, value))

    @property
    def shown(self) -> tuple[float, float, float]:
        """Lowest, highest and present value with as many digits as the slider's steps have."""
        digits = max(0, -math.floor(math.log10(self.step)))
        low, high = (f(x * 10**digits) / 10**digits for f, x in ((math.floor, self.low), (math.ceil, self.high)))
        if low <= 0 < self.low:  # a number that has to be positive
            low = self.step
        return low, high, min(max(round(self.value, digits), low), high)


def _up_to(value: float, factor: float, least: float) -> float:
    """Return the end of a slider's range: a multiple of a value, with two digits."""
    wanted = max(factor * value, least)
    digit = 10.0 ** (math.floor(math.log10(wanted)) - 1)
    return round(math.ceil(wanted / digit - 1e-9) * digit, 12)


def taper_of(whip: WhipParameters) -> float:
    """Return the thickness of a whip's tip over that of its handle; 1 for a whip whose nodes are not those of a round
    profile."""
    profile = lumped_from(whip, clamped=whip.clamped)
    return 1.0 if profile is None else math.sqrt(profile.density_taper)


def whip_knobs(base: Model, values: Mapping[str, float]) -> list[Knob]:
    """Return the knobs of a model's whip.

    Args:
        base: Model as it was loaded, from which the ranges follow.
        values: Numbers that were changed; see `changed_model`.
    """
    whip, now = base.whip, changed_model(base, values).whip
    taper = values.get("taper", taper_of(whip))
    found = [
        Knob("length", "length", "m", 0.2, _up_to(whip.length, 2.0, 0.4), now.length),
        Knob("taper", "taper, tip / handle", "", 0.2, 1.5, taper).around(taper),
        Knob("mass", "mass", "kg", round(whip.mass / 10, 4), _up_to(whip.mass, 4.0, 1e-3), now.mass),
        Knob("k", "k, stiffness", "N m/rad", 0.0, _up_to(whip.common("k"), 4.0, 0.01), now.common("k")),
        Knob("b", "b, damping", "N m s/rad", 0.0, _up_to(whip.common("b"), 4.0, 0.01), now.common("b")),
        Knob("drag", "drag of a node", "N s²/m²", 0.0, _up_to(whip.common("drag"), 4.0, DRAG), now.common("drag")),
    ]
    return [knob.around(knob.value) for knob in found if _changes(base, knob.name)]


def _changes(base: Model, name: str) -> bool:
    """Return whether a model's whip can be changed in a number: whips with a value per node may lack a profile."""
    if name == "taper":
        try:
            base.with_whip(taper=1.0)
        except InputError:
            return False
    return name not in ("k", "b") or name not in base.whip.uneven or base.whip.common(name) > 0


def whip_changes(base: Model, values: Mapping[str, float]) -> tuple[dict[str, Any], dict[str, float]]:
    """Return the arguments of `Model.with_whip` and, after it, of `Model.with_parameters` that give the changed model.

    Args:
        base: Model as it was loaded.
        values: Changed numbers by name: `length` [m], `taper`, `mass` [kg], `k` [N m/rad], `b` [N m s/rad], and `drag`
            [N s^2/m^2] of a node.
    """
    shape: dict[str, Any] = {name: values[name] for name in ("length", "taper") if name in values}
    if "taper" in shape and math.isclose(shape["taper"], taper_of(base.whip), rel_tol=_SAME):
        del shape["taper"]  # as it was loaded: whips whose nodes are not those of a round profile keep them
    whip = base.with_whip(**shape).whip if shape else base.whip
    numbers = {f"whip.{name}": values[name] for name in ("k", "b", "drag") if name in values}
    if "mass" in values:
        growth = values["mass"] / whip.mass
        numbers["whip.m"] = growth * whip.common("m")
        if whip.hinge_mass:
            numbers["whip.hinge_mass"] = growth * whip.hinge_mass
    return shape, numbers


def changed_model(base: Model, values: Mapping[str, float]) -> Model:
    """Return a model with numbers of its whip changed, see `whip_changes`.

    Raises:
        InputError: A number is out of range.
    """
    shape, numbers = whip_changes(base, values)
    model = base.with_whip(**shape) if shape else base
    return model.with_parameters(numbers) if numbers else model


_LAW_UNITS = {"beta": ("s", "s"), "K": ("N m/rad", "N/m"), "B": ("N m s/rad", "N s/m")}

_LAW_WORDS = {"a": "small is stiff", "beta": "weight of the speed", "C": "growth with the error"}


def law_names(model: Model) -> list[str]:
    """Return the names of the laws that can control a model's arm."""
    return ["position"] if model.arm.weightless else list(LAWS)


def law_named(kind: str, model: Model) -> Law:
    """Return a law with its usual numbers for a model.

    Raises:
        InputError: The law has no usual numbers.
    """
    if kind == "oiac":
        return oiac_preset("table4")
    if kind == "constant":
        if model.name in CONSTANT_PRESETS:
            return constant_preset(model.name)
        return ConstantImpedance() if model.arm.n == 2 else ConstantImpedance(100.0, 10.0)
    try:
        return LAWS.find(kind)()
    except TypeError:
        raise InputError("law", kind, "a law whose numbers all have defaults") from None


def law_knobs(law: Law, usual: Law, model: Model) -> list[Knob]:
    """Return the knobs of a law: its single numbers, and the diagonals of its matrices.

    Args:
        law: The law with its present numbers.
        usual: The law with its usual numbers, from which the ranges follow.
        model: Model whose arm it controls.
    """
    found = []
    for name, values in law.parameters().items():
        turning, sliding = _LAW_UNITS.get(name, ("", ""))
        its = usual.parameters().get(name, values)
        side = math.isqrt(len(values))
        least = _least_diagonal(np.reshape(values[: side * side], (side, side)))
        for i in range(side):
            value, origin = (float(x[i * (side + 1)]) for x in (values, its if len(its) == len(values) else values))
            joint = model.arm.joints[i] if side > 1 and i < model.arm.n else ""
            unit = sliding if joint in model.arm.slides else turning
            knob = Knob(
                f"{name}[{i}]" if side > 1 else name,
                ", ".join(filter(None, (name, joint or _LAW_WORDS.get(name, "")))),
                unit,
                max(round(origin / 20, 6), least[i]),
                _up_to(origin, 4.0, 0.1),
                value,
            )
            found.append(knob.around(value))
    return found


def _least_diagonal(matrix: np.ndarray) -> np.ndarray:
    """Return (n,), for each number of the diagonal of a matrix (n, n), the least with which it acts against any error
    while all others stay: a hundredth above the Schur complement of the others in the symmetric part.
    """
    symmetric = (matrix + matrix.T) / 2
    if len(matrix) < 2 or np.linalg.eigvalsh(symmetric)[0] <= 0:
        return np.zeros(len(matrix))
    least = np.diag(symmetric) - 1 / np.diag(np.linalg.inv(symmetric))
    return 1.01 * least


def changed_law(law: Law, name: str, value: float) -> Law:
    """Return a law with one number of `law_knobs` changed.

    Raises:
        InputError: The value is not allowed, or the law has no such number, as where a slider of the law before moves.
    """
    field, _, index = name.rstrip("]").partition("[")
    side = math.isqrt(len(law.parameters().get(field, ())))
    if int(index or 0) >= side:
        raise InputError(f"number of the law {law.kind}", name, ", ".join(law.parameters()) or "none")
    if not index:
        return replace(law, **{field: value})
    matrix = np.array(getattr(law, field), float)
    matrix[int(index), int(index)] = value
    return replace(law, **{field: tuple(map(tuple, matrix.tolist()))})


def with_law(controller: Controller, law: Law) -> Controller:
    """Return a controller with another law; options that position control does not have are dropped with it."""
    changes: dict[str, Any] = {"law": law}
    if law.kind == "position":
        changes |= {"feedforward": False, "torque_limit": None, "control_period": None, "compensated": None}
    return replace(controller, **changes)


def strike_knobs(model: Model, strike: np.ndarray, bounds: StrikeBounds) -> list[Knob]:
    """Return the knobs of a strike vector (2 a + 1,): positions of the joints at start and end, and the duration.

    Args:
        model: Model of arm and whip.
        strike: Strike vector.
        bounds: Bounds of the strikes.
    """
    arm, found = model.arm, []
    sliding = sliding_names(arm)
    joints = (*(f"{joint}, start" for joint in arm.joints), *(f"{joint}, end" for joint in arm.joints), "duration")
    for name, said, low, high, value in zip(strike_names(arm), joints, *bounds.box, strike, strict=True):
        unit = "s" if name == "D" else "m" if name in sliding else "rad"
        label = said if len(name) > _SHORT else f"{name}, {said}"
        found.append(Knob(name, label, unit, float(low), float(high), float(value)).around(float(value)))
    return found
