"""Robots by their addresses, such as `ur://192.168.0.10`: the drivers of whiptool, and those of installed packages."""

from __future__ import annotations

import socket
from collections.abc import Callable
from pathlib import Path
from typing import TypeAlias

from platformdirs import user_state_path

from whiptool.errors import NOTHING, InputError
from whiptool.extras import Registry
from whiptool.models.parameters import Model
from whiptool.rig.robots.robot import Robot

Maker: TypeAlias = Callable[[str, Model], Robot]  # of a host and the model of arm and whip; it does not connect


def _franka(host: str, model: Model) -> Robot:
    from whiptool.rig.robots.franka import Franka

    return Franka(host, model.arm.joint_limits)


def _ur(host: str, model: Model) -> Robot:
    from whiptool.rig.robots.ur import UniversalRobot

    return UniversalRobot(host, model.arm.joint_limits)


ROBOTS: Registry[Maker] = Registry("robots", Callable, {"franka": _franka, "ur": _ur}, what="robot")
NEEDS = {"franka": "pylibfranka", "ur": "rtde_control"}  # modules of extras, of whiptool's drivers
USUAL_MODELS = {"ur": "ur5e", "franka": "fr3"}  # presets
JOINTS = {"ur": 6, "franka": 7}
RULE = "franka://HOST, ur://HOST, or another robot's name, :// and HOST"
DRIVERS = "write a driver for another robot: docs/your-robot.md, Another robot"


def split_address(address: str) -> tuple[str, str]:
    """Return the name of a robot's driver, in lower case, and its host.

    Raises:
        InputError: The address is not a name, `://` and a host.
    """
    name, separator, host = address.partition("://")
    if not (name and separator and host):
        raise InputError("robot", address or NOTHING, RULE)
    return name.lower(), host


def canonical_address(address: str) -> str:
    """Return an address that is the same for all spellings of a robot's: its host by number, where it has one.

    Raises:
        InputError: The address is not a name, `://` and a host.
    """
    name, host = split_address(address)
    try:
        host = socket.gethostbyname(host)
    except (OSError, UnicodeError):  # an unknown host, or none that the network has
        host = host.lower()
    return f"{name}://{host}"


def state_file(kind: str, port: str) -> Path:
    """Return the file in which the user's state folder keeps something about an arm.

    Args:
        kind: Name of a folder, such as `stopped`.
        port: Address of a robot or serial device of servos; all spellings have the same file.

    Raises:
        InputError: The address is not a name, `://` and a host.
    """
    name = canonical_address(port).replace("://", "-") if "://" in port else Path(port).resolve().as_posix()
    return user_state_path("whiptool") / kind / (name.strip("/").replace("/", "-") + ".json")


def needs_of(address: str) -> tuple[str, ...]:
    """Return the optional modules that the driver of an address imports.

    Raises:
        InputError: The address is not a name, `://` and a host.
    """
    name, _ = split_address(address)
    return (NEEDS[name],) if name in NEEDS else ()


def robot_at(address: str, model: Model) -> Robot:
    """Return the driver of a robot, which is not connected yet.

    Args:
        address: Name of the driver, `://`, and the host of the robot's controller.
        model: Model of the robot's arm with the whip, for the number and the limits of its joints.

    Raises:
        InputError: The address has another form, or there is no such driver; the message lists the drivers.
    """
    name, host = split_address(address)
    try:
        make = ROBOTS.find(name)
    except InputError as error:
        raise InputError("robot", address, ", ".join(f"{known}://HOST" for known in ROBOTS), DRIVERS) from error
    _check_model(name, model)
    return make(host, model)


def _check_model(name: str, model: Model) -> None:
    """Refuse a model of an arm with another number of joints than the robots of whiptool's drivers."""
    usual = USUAL_MODELS.get(name)
    if usual is not None and model.arm.n != JOINTS[name]:
        rule = f"a model of the robot, such as {usual}, with {JOINTS[name]} joints"
        raise InputError("model", f"{model.name}, with {model.arm.n} joints", rule)
