"""Files that a page gives its user: settings, trajectory, film, and the Python code that does the same."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import tomli_w

from whiptool.goals.target_table import target_to_table
from whiptool.impedance.controller import controller_to_table
from whiptool.live_page.knobs import whip_changes
from whiptool.live_page.session import Shown
from whiptool.models.files import model_to_table
from whiptool.models.strike import Strike, named_strike
from whiptool.viz.page import strike_page

EXPORTS = {
    "toml": "Strike, model, controller (TOML)",
    "python": "Python code that does the same",
    "npz": "Trajectory (NPZ)",
    "csv": "Trajectory (CSV)",
    "html": "Page of the strike (HTML)",
    "mp4": "Film (MP4)",
}


def exported(shown: Shown, kind: str) -> tuple[str, bytes]:
    """Return name and content of a file of a strike; `kind` is one of `EXPORTS`. A film takes some seconds."""
    made: dict[str, Callable[[Shown], bytes]] = {
        "toml": lambda x: settings_toml(x).encode(),
        "python": lambda x: python_code(x).encode(),
        "npz": lambda x: _written("strike.npz", lambda path: x.trajectory.save(path)),
        "csv": lambda x: _written("strike.csv", lambda path: x.trajectory.to_csv(path)),
        "html": lambda x: _page(x).encode(),
        "mp4": _film,
    }
    ending = "py" if kind == "python" else kind
    return f"strike.{ending}", made[kind](shown)


def settings_toml(shown: Shown) -> str:
    """Return model, controller, target and strike as a TOML file, which `--model` and `--controller` read.

    `read_saved` reads it as a whole.
    """
    table: dict[str, Any] = {
        "model": model_to_table(shown.model),
        "controller": controller_to_table(shown.settings.controller),
        "target": {**target_to_table(shown.settings.target), "t_stay": shown.settings.t_stay},
        "strike": named_strike(Strike(shown.settings.strike), shown.model.arm),
    }
    return tomli_w.dumps(table)


def python_code(shown: Shown) -> str:
    """Return Python code that makes the same strike."""
    settings = shown.settings
    shape, numbers = whip_changes(settings.base, settings.whip)
    model = f"wt.load_model({settings.origin!r})"
    if shape:
        model += f".with_whip({', '.join(f'{name}={value!r}' for name, value in shape.items())})"
    if numbers:
        model += f".with_parameters({_plain(numbers)!r})"
    target = settings.target
    asked = "" if target.direction is None else f", direction={target.direction!r}, cone={target.cone!r}"
    asked += "" if target.speed is None else f", speed={target.speed!r}"
    asked += "" if target.sight is None else f", sight={target.sight!r}"
    return f"""\
import whiptool as wt
from whiptool.impedance.controller import controller_from_table

model = {model}
controller = controller_from_table({controller_to_table(settings.controller)!r})
target = wt.Target({target.position!r}, hit_radius={target.hit_radius!r}{asked})
strike = wt.Strike({settings.strike!r})

path = wt.CompiledRollout(model, controller).trajectory(strike, t_stay={settings.t_stay!r})
print(path.approach(target))
wt.plot_strike(path, model, target).figure.savefig("strike.png")
"""


def _plain(numbers: dict[str, float]) -> dict[str, float]:
    return {name: float(value) for name, value in numbers.items()}


def _page(shown: Shown) -> str:
    label = shown.settings.controller.law.kind
    return strike_page(shown.model, shown.trajectory, shown.settings.target, label=label, beyond=shown.beyond)


def _film(shown: Shown) -> bytes:
    from whiptool.viz.video import render_video

    def write(path: Path) -> None:
        render_video(path, shown.trajectory, shown.model, shown.settings.target, beyond=shown.beyond is not None)

    return _written("strike.mp4", write)


def _written(name: str, write: Callable[[Path], object]) -> bytes:
    """Return the content of a file that a function writes."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name
        write(path)
        return path.read_bytes()
