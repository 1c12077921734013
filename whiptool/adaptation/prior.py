"""What is believed of a whip: numbers of a plant, their estimate and covariance; before the first strike, a prior."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from whiptool.errors import InputError
from whiptool.identification.inputs import profile_of
from whiptool.identification.plant import Plant
from whiptool.identification.predict import NEUTRAL
from whiptool.identification.variables import Prior, Variable, variable
from whiptool.impedance import OIAC, Controller
from whiptool.models.files import read_toml
from whiptool.models.parameters import Model, number
from whiptool.rig.emulator.motor import Motor

# Standard errors, relative for what is positive (of its logarithm), in its own unit for what may be zero. `value`
# stands for the model's own number where it is None.
_PROFILE: dict[str, tuple[float | None, float]] = {
    "profile.length": (None, 0.15),
    "profile.linear_density": (None, 0.3),
    "profile.bending_stiffness": (None, 0.4),
    "profile.density_taper": (0.6, 0.5),
    "profile.stiffness_taper": (0.4, 0.8),
    "profile.damping_taper": (0.4, 0.8),
    "profile.rest_curvature": (0.0, 0.2),
    "profile.drag": (1e-3, 1e-3),
    "whip.dry_friction": (2e-4, 2e-4),
}
_UNIFORM: dict[str, tuple[float | None, float]] = dict.fromkeys(("whip.k", "whip.b", "whip.m", "whip.l"), (None, 0.2))
_DAMPING = 0.4  # relative error of the profile's damping, which may be zero
_ARM_FRICTION, _ARM_MASS, _GAIN, _CLOCK = 0.01, 0.1, 0.1, 0.006
_USUAL_SPEED, _INERTIA = 2.0, 0.4  # [rad/s] of a joint in a strike; relative error where there is a motor
WHIPS = ("profile", "uniform")


@dataclass(frozen=True, eq=False)  # arrays have no single truth value to compare by
class Belief:
    """A normal distribution over m named numbers of a plant and of the camera's clock.

    Args:
        plant: What it is about; what is not named is taken as known.
        names: Of `Plant.values()`, or `delay`.
        z: Mean, each number as a solver sees it (a logarithm, or a number in its usual size), (m,).
        covariance: Of z, (m, m), positive definite.
        model_error: How far the tip may be from where the best of these whips has it [m], one standard error.

    Raises:
        InputError: A name is unknown, or shapes do not fit.
    """

    plant: Plant
    names: tuple[str, ...]
    z: np.ndarray
    covariance: np.ndarray
    model_error: float = 0.0

    def __post_init__(self) -> None:
        known = {**self.plant.values(), "delay": 0.0}
        for name in self.names:
            if name not in known:
                raise InputError("prior", name, "one of " + ", ".join(known))
        m = len(self.names)
        if np.shape(self.z) != (m,) or np.shape(self.covariance) != (m, m):
            raise InputError("belief", (np.shape(self.z), np.shape(self.covariance)), f"shapes ({m},) and ({m}, {m})")

    @property
    def variables(self) -> list[Variable]:
        """How each number is counted."""
        known = {**self.plant.values(), **NEUTRAL}
        return [variable(name, known[name]) for name in self.names]

    def values(self, z: np.ndarray | None = None) -> dict[str, float]:
        """The numbers by name, of the mean or of another z; none beyond its bounds."""
        z = self.z if z is None else z
        pairs = zip(self.variables, np.asarray(z, float), strict=True)
        return {v.name: v.value(float(np.clip(x, v.lower, v.upper))) for v, x in pairs}

    def at(self, z: np.ndarray | None = None) -> Plant:
        """The plant with the mean's numbers, or with those of another z."""
        return self.plant.changed({name: x for name, x in self.values(z).items() if name != "delay"})

    def sample(self, rng: np.random.Generator, size: int) -> list[Plant]:
        """So many plants, drawn; antithetic, so that their mean is the mean's."""
        root = np.linalg.cholesky(self.covariance)
        half = rng.standard_normal((-(-size // 2), len(self.z)))
        draws = np.stack([half, -half], axis=1).reshape(-1, len(self.z))[:size]
        return [self.at(self.z + root @ draw) for draw in draws]

    def as_prior(self) -> Prior:
        """The same for `whiptool.identification.fit`."""
        scales = np.array([v.scale for v in self.variables])
        return Prior(self.names, tuple(self.values().values()), self.covariance * np.outer(scales, scales))

    def errors(self) -> dict[str, float]:
        """Standard error of each number: relative where it is a logarithm, else in its own unit."""
        scales = [v.scale for v in self.variables]
        return dict(zip(self.names, (np.sqrt(np.diag(self.covariance)) * scales).tolist(), strict=True))

    def to_table(self) -> dict[str, Any]:
        """Plain data; `from_table` gives the same belief about the same plant."""
        return {
            "names": list(self.names),
            "values": self.values(),
            "errors": self.errors(),
            "z": self.z.tolist(),
            "covariance": self.covariance.tolist(),
            "model_error": self.model_error,
        }

    @classmethod
    def from_table(cls, plant: Plant, table: Mapping[str, Any]) -> Belief:
        """What `to_table` wrote.

        Raises:
            InputError: A key is missing, or its value does not fit.
        """
        try:
            names, error = tuple(table["names"]), float(table["model_error"])
            z, covariance = np.array(table["z"], float), np.array(table["covariance"], float)
        except (KeyError, TypeError, ValueError) as fault:
            raise InputError("belief", str(table)[:80], f"names, z, covariance, model_error ({fault})") from None
        return cls(plant, names, z, covariance, error)


def default_prior(model: Model, controller: Controller, *, whip: str = "profile", motor: Motor | None = None) -> Belief:
    """A wide prior around a model: the whip, the arm's friction and mass, the controller's gain, the camera's clock.

    Args:
        model: Its whip is uniform.
        controller: Of the arm.
        whip: `profile`: length, density, stiffness, damping, a taper each, drag, dry friction, rest curvature;
            `uniform`: k, b, m and l of a uniform whip, its errors those of the family `kin`.
        motor: Of the arm's joints, as its makers describe it: its rotor turns with its link, its friction counts as
            viscous; None: ideal.

    Raises:
        InputError: `whip` is not one of these, or the model's whip has values per node.
    """
    if whip not in WHIPS:
        raise InputError("whip", whip, ", ".join(WHIPS))
    own = (_ARM_FRICTION, _ARM_FRICTION)
    arm: dict[str, tuple[float | None, float]] = {f"arm.friction[{i}]": own for i in range(model.arm.n)}
    if motor is not None:
        model = driven(model, motor)
        arm = {name: (link.friction, max(link.friction, _ARM_FRICTION)) for name, link in zip(arm, model.arm.links)}
        arm |= {f"arm.inertia[{i}]": (None, _INERTIA) for i in range(model.arm.n)}
    plant, entries = Plant(model, controller), dict(_UNIFORM) | arm
    if whip == "profile":
        profile = profile_of(model, "")
        plant = Plant(model, controller, profile)
        entries = dict(_PROFILE) | arm
        half = profile.linear_density * profile.length / model.whip.N / 2  # what point masses have beyond half a hat
        entries["profile.tip_mass"] = (half, half)
        entries["profile.bending_damping"] = (None, _DAMPING * max(profile.bending_damping, 1e-4))
        entries |= {f"arm.mass[{i}]": (None, _ARM_MASS) for i in range(model.arm.n)}
        if isinstance(controller.law, OIAC):
            entries["law.a"] = (None, _GAIN)
    return _belief(plant, entries | {"delay": (0.0, _CLOCK)})


def driven(model: Model, motor: Motor) -> Model:
    """The model with motors at its joints: a rotor turns with its link, and friction counts as viscous."""
    friction = motor.viscous_friction + motor.dry_friction / _USUAL_SPEED
    links = tuple(
        dataclasses.replace(link, inertia=link.inertia + motor.inertia, friction=link.friction + friction)  # type: ignore[operator]
        for link in model.arm.links
    )
    return dataclasses.replace(model, arm=dataclasses.replace(model.arm, links=links))


def read_belief(
    path: str | None, model: Model, controller: Controller, *, whip: str = "profile", motor: Motor | None = None
) -> Belief:
    """The default prior, changed by a file of lines such as `"profile.length" = {value = 0.9, error = 0.05}`.

    Args:
        path: A TOML file; None: the default. An error is relative where the number is positive by nature, in its own
            unit where it may be zero (drag, friction, damping, rest curvature, delay). A number that the default takes
            as known becomes unknown; `error = 0` makes it known.
        model, controller, whip, motor: As for `default_prior`.

    Raises:
        InputError: The file cannot be read, a name is unknown, or a number is out of range.
    """
    belief = default_prior(model, controller, whip=whip, motor=motor)
    if path is None:
        return belief
    values, errors = belief.values(), belief.errors()
    entries: dict[str, tuple[float | None, float]] = {name: (values[name], errors[name]) for name in belief.names}
    known, fixed = {**belief.plant.values(), "delay": 0.0}, {}
    for name, entry in read_toml(Path(path)).items():
        if name not in known:
            raise InputError(f"{path}: {name}", entry, "one of " + ", ".join(known))
        if not isinstance(entry, dict) or set(entry) != {"value", "error"}:
            raise InputError(f"{path}: {name}", entry, "{value = ..., error = ...}")
        value = number(f"{path}: {name}.value", entry["value"])
        error = number(f"{path}: {name}.error", entry["error"], low=0)
        entries.pop(name, None)
        if error:
            entries[name] = (value, error)
        else:
            fixed[name] = value
    if not entries:
        raise InputError(path, "every number known", "an error > 0 for one at least")
    plant = belief.plant.changed({name: x for name, x in fixed.items() if name != "delay"})
    return _belief(plant, entries)


def _belief(plant: Plant, entries: Mapping[str, tuple[float | None, float]]) -> Belief:
    known = {**plant.values(), "delay": 0.0}
    mean = {name: known[name] if value is None else value for name, (value, _) in entries.items()}
    plant = plant.changed({name: x for name, x in mean.items() if name != "delay"})
    variables = [variable(name, x) for name, x in mean.items()]
    z = np.array([v.z(x) for v, x in zip(variables, mean.values(), strict=True)])
    scales = np.array([v.scale for v in variables])
    errors = np.array([error for _, error in entries.values()]) / scales
    return Belief(plant, tuple(entries), z, np.diag(errors**2))


def fresh_terms(belief: Belief) -> list[str]:
    """Terms that a rollout has to be made with, lest one be zero in the mean and not in a sample."""
    of = {"profile.drag": "whip.drag", "profile.rest_curvature": "whip.rest_angle"}
    terms = [of.get(name, name) for name in belief.names if name.startswith(("whip.", "arm.")) or name in of]
    return terms if belief.plant.profile is None else ["whip.hinge_mass", *terms]
