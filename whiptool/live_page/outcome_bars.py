"""What a strike does, as bars with numbers and units: distance, direction, speed, limits and clearance."""

from __future__ import annotations

import html
import math
from dataclasses import dataclass

import numpy as np

from whiptool.limits.all_limits import AllLimits
from whiptool.limits.arm_limits import ArmLimits
from whiptool.limits.clearance import Clearance
from whiptool.live_page.session import Shown
from whiptool.viz.style import COLORS

_LEAST = 1e-5  # [m] of a miss distance that is stated
FULL_CLEARANCE = 0.25  # [m] at which the bar of the clearance is full


@dataclass(frozen=True)
class Bar:
    """One line of the outcome.

    Args:
        label: What is measured.
        text: Its value and what is allowed, with units.
        share: Length of the bar, 0 to 1 and above; 1 is what is allowed.
        good: Whether it is as it has to be; None: nothing is required.
    """

    label: str
    text: str
    share: float
    good: bool | None = None


def millimetres(length: float) -> str:
    """Return a length [m] as text in mm, with three digits; from a metre on in m."""
    if length >= 1:
        return f"{length:.3g} m"
    return f"{1e3 * length:.3g} mm" if length >= _LEAST else f"below {1e3 * _LEAST:g} mm"


def outcome_bars(shown: Shown, limits: AllLimits) -> list[Bar]:
    """Return the bars of a strike."""
    if shown.trajectory.diverged:
        return [Bar("simulation", f"diverged at {shown.trajectory.t[-1]:.3f} s", 1.0, good=False)]
    return [*_arrival(shown), *_torques(shown), *_limits(shown, limits)]


def _arrival(shown: Shown) -> list[Bar]:
    target, near = shown.settings.target, shown.near
    goals, distance = target.goals, float(near.distance[0])
    met = {part: bool(by[0] <= 0) for part, by in goals.excess(near.farthest, near.velocity).items()}
    within = f"{millimetres(distance)} of {millimetres(target.hit_radius)} allowed"
    bars = [Bar("miss distance", within, distance / target.hit_radius, met["point"])]
    if target.direction is not None:
        angle = float(goals.angle(near.velocity)[0])
        text = f"{math.degrees(angle):.1f}° of {math.degrees(target.cone):.3g}° allowed"
        bars.append(Bar("direction", text, angle / target.cone, met["direction"]))
    speed, fastest = float(goals.arrival_speed(near.velocity)[0]), float(shown.trajectory.tip_speed.max())
    along = " along the direction" if target.direction is not None else ""
    if target.speed is None:
        bars.append(Bar("tip speed", f"{speed:.1f} m/s{along}; fastest {fastest:.1f} m/s", max(speed, 0) / fastest))
    else:
        text = f"{speed:.1f} m/s{along}, at least {target.speed:.3g} m/s"
        bars.append(Bar("tip speed", text, max(speed, 0) / target.speed, met["speed"]))
    return bars


def _torques(shown: Shown) -> list[Bar]:
    arm, torque = shown.model.arm, np.abs(shown.trajectory.tau).max(axis=0)
    if arm.weightless or any(math.isfinite(joint.torque) for joint in arm.joint_limits):
        return []  # not known, or with the limits
    joint = int(torque.argmax())
    what, unit = ("force", "N") if arm.joints[joint] in arm.slides else ("torque", "N m")
    return [Bar(f"largest {what}", f"{torque[joint]:.3g} {unit} ({arm.joints[joint]}); no limit", 0.0)]


def _limits(shown: Shown, limits: AllLimits) -> list[Bar]:
    bars = []
    for each in limits.members:
        if isinstance(each, ArmLimits):
            bars += _of_joints(each, shown)
        elif isinstance(each, Clearance):
            bars += _clearance(each, shown)
        else:
            used = each.violation(shown.trajectory) + 1
            bars.append(Bar(each.words, f"{used:.0%} of the limit", used, used <= 1))
    if shown.beyond is not None and all(bar.good is not False for bar in bars):  # of a kind that has no bar
        bars.append(Bar("limit", shown.beyond, 1.0, good=False))
    return bars


def _of_joints(limits: ArmLimits, shown: Shown) -> list[Bar]:
    arm, path = shown.model.arm, shown.trajectory
    usage = limits.usage(path.q[:, : arm.n], path.v[:, : arm.n], path.tau).max(axis=0)  # (3, a)
    bars = []
    for name, used in zip(("joint positions", "joint speeds", "joint torques"), usage, strict=True):
        joint = int(used.argmax())
        if used[joint] > 0:
            text = f"{used[joint]:.0%} of the limit ({arm.joints[joint]})"
            bars.append(Bar(name, text, float(used[joint]), bool(used[joint] <= 1)))
    return bars


def _clearance(limits: Clearance, shown: Shown) -> list[Bar]:
    found, at = limits.nearest(shown.trajectory)
    if found is None:
        return []
    where = f"{found.names[0]} to {found.names[1]}"
    size = millimetres(abs(found.clearance))
    text = f"{size}, {where}" if found.clearance >= 0 else f"{size} inside: {where}, at {at:.2f} s"
    return [Bar("clearance", text, max(found.clearance, 0.0) / FULL_CLEARANCE, found.clearance >= limits.least)]


_TRACK = "height:6px;border-radius:3px;background:var(--mantine-color-default-border,#ddd);overflow:hidden"


def bars_html(shown: Shown, bars: list[Bar], *, computing: bool = False) -> str:
    """Return the outcome of a strike as HTML, in which all text is escaped.

    Args:
        shown: What the strike does.
        bars: Its outcome.
        computing: Whether something newer is computed: the outcome is then pale, and has no verdict.
    """
    verdict, color = ("✓ Hit", COLORS["green"]) if shown.hit else ("✗ Miss", COLORS["vermilion"])
    if computing:
        verdict, color = "Computing …", "inherit"
    target, reach = shown.settings.target, shown.model.reach
    far = math.hypot(*target.position) > reach + target.hit_radius
    why = f"beyond a limit: {shown.beyond}" if shown.beyond else ""
    why = f"the target is beyond the arm's and whip's reach of {reach:.3g} m" if far else why
    rows = "".join(_row(bar) for bar in bars)
    note = f'<div style="margin-top:2px;color:{COLORS["vermilion"]}">{html.escape(why)}</div>' if why else ""
    return (
        f'<div class="outcome" data-number="{shown.number}" data-hit="{str(shown.hit).lower()}" '
        f'style="font-size:0.8rem;padding:0.3rem 0.9rem;line-height:1.25">'
        f'<div style="font-size:1.15rem;font-weight:700;color:{color}">{verdict}</div>'
        f'<div style="opacity:{0.35 if computing else 1}">{note}{rows}'
        f'<div style="margin-top:6px;opacity:0.75">Strike: {html.escape(shown.source)}</div></div></div>'
    )


def _row(bar: Bar) -> str:
    color = {True: COLORS["green"], False: COLORS["vermilion"], None: COLORS["blue"]}[bar.good]
    mark = {True: "✓ ", False: "✗ ", None: ""}[bar.good]
    width = 100 * min(max(bar.share, 0.0), 1.0) if math.isfinite(bar.share) else 100.0
    return (
        f'<div style="margin-top:5px"><div style="display:flex;gap:8px;justify-content:space-between">'
        f"<span>{html.escape(bar.label)}</span>"
        f'<span style="text-align:right">{mark}{html.escape(bar.text)}</span></div>'
        f'<div style="{_TRACK}"><div style="height:100%;width:{width:.1f}%;background:{color}"></div></div></div>'
    )
