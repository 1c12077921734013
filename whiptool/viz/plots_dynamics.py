"""Figures of the whip's dynamics: energies, modes, and speeds along the whip.

As in `whiptool.viz.plots`, every function draws into given axes and returns them.
"""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from whiptool.dynamics.modes import Modes
from whiptool.errors import InputError
from whiptool.models.kinematics import chain_motion
from whiptool.models.parameters import Model
from whiptool.models.trajectory import Trajectory
from whiptool.rollout.energy import Energies
from whiptool.viz.style import COLORS


def along_whip(model: Model) -> np.ndarray:
    """Return the distances of hand, nodes and tip from the hand along the whip [m], (N + 1,)."""
    return np.r_[0.0, np.cumsum(model.whip.per_node("l"))]


def plot_energy_flow(ax: Axes, energies: Energies, model: Model) -> Axes:
    """Draw the kinetic energy of every node [mJ] over time [s] and distance from the hand [m], as an image with a
    colour bar.

    A line shows the centroid of the whip's kinetic energy, at times when the energy is at least 2 % of its maximum.
    """
    s, kinetic = along_whip(model), energies.kinetic[:, model.arm.n :]  # (T, N)
    # each node's cell reaches halfway to its neighbours; the hand's own half has no node
    edges = np.r_[s[0], (s[1:-1] + s[2:]) / 2, s[-1]] if model.whip.N > 1 else s
    steps = slice(None, None, max(1, len(energies.t) // 600))  # an image needs no more columns
    t = energies.t[steps]
    image = ax.pcolormesh(
        np.r_[t, 2 * t[-1] - t[-2]], edges, 1e3 * kinetic[steps].T, cmap="viridis", shading="flat", rasterized=True
    )
    total = kinetic.sum(axis=1)
    moving = total > 0.02 * total.max()
    centre = np.where(moving, (kinetic @ s[1:]) / np.where(moving, total, 1), np.nan)
    ax.plot(energies.t, centre, color="white", linewidth=1.6, label="centre of the energy")
    ax.legend(labelcolor="white", loc="upper left")
    figure = ax.get_figure()
    assert figure is not None
    figure.colorbar(image, ax=ax, pad=0.02, label="kinetic energy of a node [mJ]")
    ax.set(xlabel="time [s]", ylabel="distance from the hand [m]", xlim=(t[0], t[-1]))
    ax.grid(visible=False)
    return ax


def plot_energy_balance(ax: Axes, energies: Energies) -> Axes:
    """Draw the work of the motors, kinetic and potential energy (less its initial value), and losses [J] over time
    [s]."""
    potential = (energies.weight + energies.springs).sum(axis=1)
    curves = (
        ("work of the motors", energies.work, "black", "-"),
        ("kinetic", energies.kinetic.sum(axis=1), "blue", "-"),
        ("weight and springs", potential - potential[0], "green", "--"),
        ("lost", energies.lost, "vermilion", "-."),
    )
    for label, values, color, style in curves:
        ax.plot(energies.t, values, color=COLORS[color], linestyle=style, label=label)
    ax.set(xlabel="time [s]", ylabel="energy [J]", xlim=(energies.t[0], energies.t[-1]))
    ax.legend()
    return ax


def plot_mode_shapes(ax: Axes, modes: Modes, model: Model, *, count: int = 4) -> Axes:
    """Draw the lowest modes of the hanging whip: lateral displacement, scaled to 1, over the depth below the hand [m].

    In space each mode is seen along the direction in which it moves most.

    Args:
        ax: Axes to draw into.
        modes: Modes of the whip on a fixed arm.
        model: Model of the whip.
        count: Number of modes.

    Raises:
        InputError: `count` is not from 1 to the number of modes.
    """
    if not 1 <= count <= len(modes.frequencies):
        raise InputError("count", count, f"a whole number from 1 to {len(modes.frequencies)}")
    colors, styles = ("blue", "vermilion", "green", "pink", "orange", "sky", "black"), ("-", "--", "-.", ":")
    moved = modes.displacements[:count]  # (count, N + 1, d)
    farthest = moved[np.arange(count), np.linalg.norm(moved, axis=2).argmax(axis=1)]
    x = (moved @ farthest[:, :, None])[..., 0]  # (count, N + 1)
    for i, (shape, frequency, ratio) in enumerate(zip(x, modes.frequencies, modes.damping_ratios, strict=False)):
        damping = "overdamped" if np.isnan(ratio) else rf"$\zeta$ = {ratio:.3g}"
        ax.plot(
            shape / np.abs(shape).max(),
            along_whip(model),
            "o",
            linestyle=styles[i % len(styles)],
            markersize=3.5,
            color=COLORS[colors[i % len(colors)]],
            label=f"{frequency:.2f} Hz, {damping}",
        )
    ax.axvline(0, color="0.6", linewidth=0.8)
    ax.set(xlabel="sideways displacement (largest: 1)", ylabel="depth below the hand [m]")
    if not ax.yaxis_inverted():
        ax.invert_yaxis()
    ax.legend(loc="center left", bbox_to_anchor=(1, 0.5))
    return ax


def plot_speed_along_whip(
    ax: Axes, trajectory: Trajectory, model: Model, *, label: str = "", color: str = "blue", marker: str = "o"
) -> Axes:
    """Draw the largest speed [m/s] of hand, nodes and tip in a strike over their distance from the hand [m].

    Args:
        ax: Axes to draw into; call again for another strike.
        trajectory, model: Trajectory of the strike, and the model with which it was simulated.
        label: Label for a legend, which the caller adds.
        color: A key of `whiptool.viz.style.COLORS`.
        marker: Marker of matplotlib.
    """
    velocity = chain_motion(model, trajectory.q, trajectory.v)[1][:, model.arm.n :]  # (T, N + 1, 2 or 3)
    largest = np.linalg.norm(velocity, axis=-1).max(axis=0)
    ax.plot(along_whip(model), largest, marker=marker, markersize=4.5, color=COLORS[color], label=label)
    ax.set(xlabel="distance from the hand [m]", ylabel="largest speed [m/s]")
    ax.set_ylim(0, max(ax.get_ylim()[1], 1.06 * largest.max()))
    return ax
