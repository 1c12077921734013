"""The belief about a whip's parameters, mean and covariance; before the first strike it is the prior."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.linalg import block_diag

from whiptool.adaptation.materials import NUMBERS, Stock, stock_of_model
from whiptool.adaptation.model_error import NONE, ModelError
from whiptool.errors import InputError, expect
from whiptool.given_files import read_toml
from whiptool.identification.plant import Plant
from whiptool.identification.readings import NEUTRAL
from whiptool.identification.variables import Prior, Variable, units, variable
from whiptool.impedance import Controller
from whiptool.models.numbers import number
from whiptool.models.parameters import Model
from whiptool.models.profile import WAVES, WhipProfile, profile_from
from whiptool.rig.emulator.motor import Motor

# Standard errors. A whip's tip is as thick as its handle, or half or twice as thick two of them off: mass goes with the
# square of the thickness, bending with its fourth power. A little of each taper is its own.


@dataclass(frozen=True)
class Spread:
    """Standard deviations of the prior of a whip; those without unit are relative.

    Density scales with thickness squared, stiffness and damping with its fourth power. Their independent tapers have
    therefore errors in the ratio 1 to 2, and a thickness error of 7 % changes mass by 15 % and stiffness by 30 %.
    """

    thickness_taper: float = 0.35  # taper of thickness; density, stiffness and damping scale with powers of it
    own_taper: float = 0.2  # independent further error of density's taper; stiffness and damping have twice as much
    rest_curvature: float = 0.3  # [1/m]: a twentieth of that of a coil of 0.15 m radius, which a stored rope keeps
    along: float = 0.3  # ratio of drag along a whip to that across; the mean is 0.5
    stiffening: float = 0.2  # relative increase of a joint's stiffness at a usual bend, and its mean
    bead: float = 0.1  # mass of a bead or knot as a fraction of the whip's mass, and its mean
    bead_place: float = 0.25  # position of the bead, as a fraction of the length
    density_wave: float = 0.15  # first Fourier component of density along the whip, beyond the taper
    stiffness_wave: float = 0.25  # first Fourier component of stiffness along the whip, beyond the taper
    wave_falls: float = 0.8  # ratio of the error of each further component to that of the one before
    arm_friction: float = 0.01  # [N m s/rad]
    arm_mass: float = 0.1  # masses of the arm's links
    gain: float = 0.1  # the controller's gains
    clock: float = 0.006  # the camera's clock [s]
    usual_speed: float = 2.0  # of a joint in a strike [rad/s], to convert dry to viscous friction; not an error
    usual_bend: float = 4.0  # curvature that most of a whip stays below in a strike [1/m]; not an error
    inertia: float = 0.4  # of a motor


_SPREAD = Spread()
_TAPERS = {"profile.density_taper": 2, "profile.stiffness_taper": 4, "profile.damping_taper": 4}
WHIPS = ("profile", "uniform")
UNSEEN = ModelError(0.01, 1.5)  # before any recording of a moving whip


@dataclass(frozen=True, eq=False)  # arrays have no single truth value to compare by
class Belief:
    """A normal distribution over m named parameters of a plant and of the camera's clock."""

    plant: Plant  # model and controller; all their parameters that are not in `names` are taken as known
    names: tuple[str, ...]  # as in `Plant.values()`, or `delay` for the delay of the camera's clock
    z: np.ndarray  # mean in solver variables: logarithms of positive numbers, others over their usual size, (m,)
    covariance: np.ndarray  # of z, (m, m), positive definite
    model_error: ModelError = NONE  # distance between the tip's true path and that of the best-fitting whip

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
        """The solver's variable of each parameter: its scale and bounds."""
        known = {**self.plant.values(), **NEUTRAL}
        unit_of = units(self.plant.model.arm, self.plant.controller, self.names)
        return [variable(name, known[name], unit=unit_of[name]) for name in self.names]

    def values(self, z: np.ndarray | None = None) -> dict[str, float]:
        """Return the parameters by name, at the mean or at another z (m,), clipped to their bounds."""
        z = self.z if z is None else z
        pairs = zip(self.variables, np.asarray(z, float), strict=True)
        return {v.name: v.value(float(np.clip(x, v.lower, v.upper))) for v, x in pairs}

    def at(self, z: np.ndarray | None = None) -> Plant:
        """Return the plant with the parameters of the mean, or of another z (m,)."""
        return self.plant.changed({name: x for name, x in self.values(z).items() if name != "delay"})

    def sample(self, rng: np.random.Generator, size: int) -> list[Plant]:
        """Draw `size` plants from the belief, in antithetic pairs, so that the mean of their z is that of the
        belief."""
        root = np.linalg.cholesky(self.covariance)
        half = rng.standard_normal((-(-size // 2), len(self.z)))
        draws = np.stack([half, -half], axis=1).reshape(-1, len(self.z))[:size]
        return [self.at(self.z + root @ draw) for draw in draws]

    def as_prior(self) -> Prior:
        """Return the belief as a prior for `whiptool.identification.fit`."""
        scales = np.array([v.scale for v in self.variables])
        return Prior(self.names, tuple(self.values().values()), self.covariance * np.outer(scales, scales))

    def errors(self) -> dict[str, float]:
        """Return the standard deviation of each parameter by name: relative if the solver's variable is its logarithm,
        else in its own unit.
        """
        scales = [v.scale for v in self.variables]
        return dict(zip(self.names, (np.sqrt(np.diag(self.covariance)) * scales).tolist(), strict=True))

    def to_table(self) -> dict[str, Any]:
        """Return the belief as plain data, from which `from_table` restores it for the same plant."""
        return {
            "names": list(self.names),
            "values": self.values(),
            "errors": self._errors_of_values(),
            "z": self.z.tolist(),
            "covariance": self.covariance.tolist(),
            "model_error": dataclasses.asdict(self.model_error),
        }

    def _errors_of_values(self) -> dict[str, float]:
        """Standard error of each of the `values`, in its unit."""
        slopes = [v.slope(z) for v, z in zip(self.variables, self.z, strict=True)]
        return dict(zip(self.names, (np.sqrt(np.diag(self.covariance)) * slopes).tolist(), strict=True))

    @classmethod
    def from_table(cls, plant: Plant, table: Mapping[str, Any]) -> Belief:
        """Return the belief from a table of `to_table`."""
        try:
            names, error = tuple(table["names"]), ModelError(**table["model_error"])
            z, covariance = np.array(table["z"], float), np.array(table["covariance"], float)
        except (KeyError, TypeError, ValueError) as fault:
            rule = f"a table with names, z, covariance and model_error ({fault})"
            raise InputError("belief", str(table)[:80], rule) from None
        return cls(plant, names, z, covariance, error)


@dataclass(frozen=True)
class Learned:
    """The belief after an update, and how each recording was used.

    Errors of neighbouring frames are correlated and may be larger than stated, which `redundancy` expresses.
    """

    belief: Belief  # the posterior
    rmse: dict[str, float]  # root mean square error of each recording that was used, by source [m]
    refused: dict[str, str]  # why a recording was not used, by source
    wall_time: float  # of the update [s]
    redundancy: float = 1.0  # number of readings with the information of one independent reading of the stated error


def default_prior(
    model: Model,
    controller: Controller,
    *,
    whip: str = "profile",
    motor: Motor | None = None,
    stock: Stock | None = None,
) -> Belief:
    """Return a wide prior of the whip, the arm's friction and mass, the controller's gain and the camera's clock.

    The whip's parameters have the spread and the correlations of a material: a thicker whip is heavier and much
    stiffer. The means of other parameters are those of a uniform whip without rest curvature.

    Args:
        model: Nominal model with a uniform whip.
        controller: Controller of the arm.
        whip: `profile`: length, density, stiffness, damping, a taper each, drag, dry friction, rest curvature;
            `uniform`: k, b, m and l of a uniform whip.
        motor: Motor of the arm's joints, by its data sheet: its rotor inertia is added to the joint, and its friction
            counts as viscous; None: an ideal motor.
        stock: Material of the whip; None: centred on the model, with the average width of materials.

    Raises:
        InputError: `whip` is not one of these, or the model's whip has values per node.
    """
    expect(Model, model=model)
    expect(Controller, controller=controller)
    expect(str, whip=whip)
    if whip not in WHIPS:
        raise InputError("whip", whip, ", ".join(WHIPS))
    if stock is not None:
        model = stock.owned(model)
    entries: dict[str, tuple[float | None, float]] = {}
    if not controller.prescribed:  # else the joints are exactly on their path, whatever the arm weighs
        entries = {f"arm.friction[{i}]": (_SPREAD.arm_friction, _SPREAD.arm_friction) for i in range(model.arm.n)}
    if motor is not None:
        model = driven(model, motor)
        friction = [link.friction for link in model.arm.links]
        entries = {name: (x, max(x, _SPREAD.arm_friction)) for name, x in zip(entries, friction, strict=True)}
        entries |= {f"arm.inertia[{i}]": (None, _SPREAD.inertia) for i in range(model.arm.n)}
    entries["delay"] = (0.0, _SPREAD.clock)
    if whip == "uniform":
        return _joined(_uniform(Plant(model, controller), stock or stock_of_model(model)), entries)
    if stock is None:
        stock = stock_of_model(model)
        model = stock.owned(model)  # with drag and friction, where it has none
    if not controller.prescribed:
        entries |= {f"arm.mass[{i}]": (None, _SPREAD.arm_mass) for i in range(model.arm.n)}
    entries |= {f"law.{name}": (None, _SPREAD.gain) for name in _uncertain(controller)}
    return _joined(_profile(Plant(model, controller, profile_from(model.whip)), stock), entries)


def _uncertain(controller: Controller) -> tuple[str, ...]:
    """Return the parameters of the controller's law that are not exactly known."""
    names = getattr(controller.law, "uncertain", None)
    if names is None:
        rule = "a law that says which of its parameters are not exactly known"
        fix = 'add uncertain = ("NAME", ...) to its class, or an empty tuple'
        raise InputError("controller.law", controller.law.kind, rule, fix)
    return names


def _uniform(plant: Plant, stock: Stock) -> Belief:
    """k, b, m and l of a uniform whip: from a stock's length, density, stiffness and damping."""
    names = ("whip.k", "whip.b", "whip.m", "whip.l")
    of = np.array([[-1, 0, 1, 0], [-1, 0, 0, 1], [1, 1, 0, 0], [1, 0, 0, 0]]) @ np.eye(4, len(NUMBERS))
    own = _belief(plant, dict.fromkeys(names, (None, 1.0)))
    return dataclasses.replace(own, covariance=of @ stock.covariance @ of.T)


def _profile(plant: Plant, stock: Stock) -> Belief:
    """A stock's numbers, tapers that go together, a marker's mass, what is uneven; in the plane a rest curvature."""
    names = [f"profile.{name}" for name in NUMBERS[:-1]] + ["whip.dry_friction"]
    entries: dict[str, tuple[float | None, float]] = dict.fromkeys(names, (None, 1.0))
    entries |= dict.fromkeys(_TAPERS, (None, 1.0))
    profile = plant.profile
    assert profile is not None
    half = profile.linear_density * profile.length / plant.model.whip.N / 2  # what point masses have beyond half a hat
    entries |= {"profile.tip_mass": (half, half)}
    entries |= _uneven(profile, plant.model.whip.N)
    if plant.model.dimension == 2:  # in space a bend has a direction, too
        entries |= {"profile.rest_curvature": (None, _SPREAD.rest_curvature)}
    belief = _belief(plant, entries)
    covariance = np.array(belief.covariance)
    # a number that has no logarithm moves by its size times what its logarithm would
    size = [1.0 if v.log else x for v, x in zip(belief.variables, belief.z, strict=True)][: len(names)]
    covariance[: len(names), : len(names)] = stock.covariance * np.outer(size, size)
    powers, tapers = np.array([*_TAPERS.values()]), slice(len(names), len(names) + len(_TAPERS))
    common = _SPREAD.thickness_taper**2 * np.outer(powers, powers)
    covariance[tapers, tapers] = common + np.diag((_SPREAD.own_taper * powers) ** 2 / 4)
    return dataclasses.replace(belief, covariance=covariance)


def _uneven(profile: WhipProfile, N: int) -> dict[str, tuple[float | None, float]]:
    """What makes a whip of N nodes differ from a tapered one: air along it, springs that stiffen, a bead, waves of
    thickness."""
    bead = _SPREAD.bead * profile.linear_density * profile.length
    l = profile.length / N
    stiffening = _SPREAD.stiffening * profile.bending_stiffness / l / (_SPREAD.usual_bend * l) ** 2
    entries: dict[str, tuple[float | None, float]] = {
        "whip.drag_ratio": (0.5, _SPREAD.along),
        "whip.cubic_stiffness": (stiffening, stiffening),
        "profile.bead_mass": (bead, bead),
        "profile.bead_place": (0.6, _SPREAD.bead_place),
    }
    for name, first in (("density", _SPREAD.density_wave), ("stiffness", _SPREAD.stiffness_wave)):
        entries |= {f"profile.{name}_waves[{i}]": (0.0, first * _SPREAD.wave_falls**i) for i in range(WAVES)}
    return entries


def _joined(belief: Belief, entries: Mapping[str, tuple[float | None, float]]) -> Belief:
    """A belief, and independent numbers of the same plant, in addition to its own or in their place."""
    other = _belief(belief.plant, entries)
    kept = [i for i, name in enumerate(belief.names) if name not in entries]
    names = tuple(belief.names[i] for i in kept) + other.names
    covariance = np.array(block_diag(belief.covariance[np.ix_(kept, kept)], other.covariance))
    return Belief(other.plant, names, np.r_[belief.z[kept], other.z], covariance, belief.model_error)


def driven(model: Model, motor: Motor) -> Model:
    """Return the model with motors at its joints: rotor inertia and friction, counted as viscous, are added to the
    arm's.
    """
    friction = motor.viscous_friction + motor.dry_friction / _SPREAD.usual_speed
    added = {f"arm.inertia[{i}]": motor.inertia for i in range(model.arm.n)}
    added |= {f"arm.friction[{i}]": friction for i in range(model.arm.n)}
    named = model.parameters()
    return model.with_parameters({name: named[name] + x for name, x in added.items()})


def read_belief(
    path: str | None,
    model: Model,
    controller: Controller,
    *,
    whip: str = "profile",
    motor: Motor | None = None,
    stock: Stock | None = None,
) -> Belief:
    """Return the default prior, changed by a file of lines such as `"profile.length" = {value = 0.9, error = 0.05}`.

    In the TOML file an error is relative for a parameter that is always positive, and in its own unit for one that may
    be zero (drag, friction, damping, rest curvature, delay). A parameter in the file becomes unknown if the default
    takes it as known; `error = 0` makes it known. Parameters in the file are independent of all others.
    """
    belief = default_prior(model, controller, whip=whip, motor=motor, stock=stock)
    if path is None:
        return belief
    known, given, fixed = {**belief.plant.values(), "delay": 0.0}, {}, {}
    for name, entry in read_toml(Path(path)).items():
        if name not in known:
            raise InputError(f"{path}: {name}", entry, "one of the parameters " + ", ".join(known))
        if not isinstance(entry, dict) or set(entry) != {"value", "error"}:
            raise InputError(f"{path}: {name}", entry, "{value = ..., error = ...}")
        value = number(f"{path}: {name}.value", entry["value"])
        error = number(f"{path}: {name}.error", entry["error"], low=0)
        if error:
            given[name] = (value, error)
        else:
            fixed[name] = value
    left = knowing(belief, fixed)
    if not left.names and not given:
        raise InputError(path, "every number known", "an error > 0 for at least one parameter")
    return _joined(left, given) if given else left


def knowing(belief: Belief, values: Mapping[str, float]) -> Belief:
    """Return the belief with some parameters set to known values; the distribution of the others is unchanged."""
    kept = [i for i, name in enumerate(belief.names) if name not in values]
    plant = belief.plant.changed({name: x for name, x in values.items() if name != "delay"})
    names = tuple(belief.names[i] for i in kept)
    return Belief(plant, names, belief.z[kept], belief.covariance[np.ix_(kept, kept)], belief.model_error)


def _belief(plant: Plant, entries: Mapping[str, tuple[float | None, float]]) -> Belief:
    known = {**plant.values(), "delay": 0.0}
    mean = {name: known[name] if value is None else value for name, (value, _) in entries.items()}
    plant = plant.changed({name: x for name, x in mean.items() if name != "delay"})
    variables = [variable(name, x) for name, x in mean.items()]
    z = np.array([v.z(x) for v, x in zip(variables, mean.values(), strict=True)])
    scales = np.array([v.scale for v in variables])
    errors = np.array([error for _, error in entries.values()]) / scales
    return Belief(plant, tuple(entries), z, np.diag(errors**2), UNSEEN)


def fresh_terms(belief: Belief) -> list[str]:
    """Return the names of the model's terms, such as `whip.drag`, that a simulator must include even if they are zero
    for the mean of the belief, because they may differ from zero for samples.
    """
    of = {"profile.drag": "whip.drag", "profile.rest_curvature": "whip.rest_angle"}
    terms = [of.get(name, name) for name in belief.names if name.startswith(("whip.", "arm.")) or name in of]
    return terms if belief.plant.profile is None else ["whip.hinge_mass", *terms]
