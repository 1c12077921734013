"""Units of the free numbers, by their names."""

from __future__ import annotations

from collections.abc import Sequence

from whiptool.words import rounded

_LINK = {
    "mass": "kg", "length": "m", "com": "m", "inertia": "kg m^2", "friction": "N m s/rad",
    "position": "m", "armature": "kg m^2", "hand_position": "m",
}  # fmt: skip
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


_OF_SLIDES = {"friction": "N s/m", "armature": "kg", "torque_limit": "N"}


def unit_of(name: str, slides: Sequence[bool] = ()) -> str:
    """Return the unit of a parameter; empty if it has none.

    Args:
        name: Name of the parameter, such as `whip.k[3]`, `arm.com[0].x`, `profile.length`, `law.K[1]` or `delay`.
        slides: Which joints of the arm are prismatic, (a,), as the unit of a gain depends on it: for two joints
            `law.K[1]` is torque of joint 1 per position of joint 2. Empty: all are revolute.
    """
    group, dot, quantity = name.partition(".")
    group, quantity = (group, quantity) if dot else ("", name)
    symbol, _, rest = quantity.split(".")[0].partition("[")
    if any(slides) and rest:
        number = int(rest.rstrip("]"))
        if group == "law" and symbol in ("K", "B"):
            row, column = divmod(number, len(slides))
            return _gain(symbol, force=slides[row], length=slides[column])
        if group in ("arm", "") and symbol in _OF_SLIDES and slides[number]:
            return _OF_SLIDES[symbol]
    return _UNITS.get(group, {}).get(symbol, "")


def _gain(symbol: str, *, force: bool, length: bool) -> str:
    """Return the unit of a stiffness K or damping B: of a force or a torque, per length or angle."""
    return f"{'N' if force else 'N m'}{' s' if symbol == 'B' else ''}/{'m' if length else 'rad'}"


def with_unit(value: float, unit: str, digits: int = 5) -> str:
    """Return a value with its unit as text, rounded to `digits` significant digits."""
    return f"{rounded(value, digits)} {unit}".strip()
