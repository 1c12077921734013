"""Robots by their addresses, such as `ur://192.168.0.10`: the drivers of whiptool, and those of installed packages."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

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
RULE = "franka://HOST, ur://HOST, or another robot's name, :// and HOST"


def split_address(address: str) -> tuple[str, str]:
    """Return the name of a robot's driver and its host.

    Raises:
        InputError: The address is not a name, `://` and a host.
    """
    name, separator, host = address.partition("://")
    if not (name and separator and host):
        raise InputError("robot", address or NOTHING, RULE)
    return name, host


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
    return ROBOTS.find(name)(host, model)
