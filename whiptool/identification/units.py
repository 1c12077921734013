"""Units of the free numbers, by their names."""

from __future__ import annotations

from whiptool.words import rounded

_LINK = {"mass": "kg", "length": "m", "com": "m", "inertia": "kg m^2", "friction": "N m s/rad"}
_UNITS = {
    "whip": {
        "l": "m", "m": "kg", "k": "N m/rad", "b": "N m s/rad", "rest_angle": "rad", "dry_friction": "N m",
        "friction_velocity": "rad/s", "drag": "N s^2/m^2", "hinge_mass": "kg",
        "cubic_stiffness": "N m/rad^3", "rest_angle_x": "rad", "node_inertia": "kg m^2",
    },
    "arm": _LINK,
    "link": {**_LINK, "dry_friction": "N m", "drag": "N s^2/m^2"},
    "profile": {
        "length": "m", "linear_density": "kg/m", "bending_stiffness": "N m^2", "bending_damping": "N m^2 s",
        "rest_curvature": "1/m", "drag": "N s^2/m^3", "tip_mass": "kg", "bead_mass": "kg",
    },
    "law": {"beta": "s", "K": "N m/rad", "B": "N m s/rad"},
    "": {
        "gravity": "m/s^2", "friction_velocity": "rad/s",
        "torque_limit": "N m", "delay": "s", "clamp": "rad", "rotation": "rad", "shift_x": "m", "shift_y": "m",
        "rotation_x": "rad", "rotation_y": "rad", "rotation_z": "rad", "shift_z": "m",
    },
}  # fmt: skip


def unit_of(name: str) -> str:
    """Return the unit of a free number by its name (`whip.k[3]`, `profile.length`, `delay`); empty: it has none."""
    group, _, quantity = name.rpartition(".")
    return _UNITS.get(group, {}).get(quantity.split("[")[0], "")


def with_unit(name: str, value: float, digits: int = 5) -> str:
    """Return a free number's value with its unit, to so many significant digits."""
    return f"{rounded(value, digits)} {unit_of(name)}".strip()
