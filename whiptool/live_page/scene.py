"""The scene in three dimensions: arm, whip, target with its direction and cone, ghost, heat map, tolerance ellipses."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import matplotlib
import numpy as np

from whiptool.goals.target import Target
from whiptool.live_page.heat_map import HeatMap
from whiptool.live_page.meshes import (
    Mesh,
    cone_mesh,
    drawn_mesh,
    ellipse_points,
    ellipsoid_mesh,
    joined,
    rod_mesh,
    shape_mesh,
)
from whiptool.live_page.postures import ScenePostures, postures, shapes
from whiptool.live_page.session import Shown
from whiptool.live_page.spread import INSIDE, TipSpread
from whiptool.models.kinematics import upright
from whiptool.models.mount import default_floor
from whiptool.models.parameters import Model
from whiptool.models.visuals import Look
from whiptool.viz.style import COLORS, SPEED

if TYPE_CHECKING:
    from viser import SceneApi

_HANDLE = 0.16  # of the reach, from the target to the ball that sets the direction
_GRIP = 0.02  # of the reach, radius of the balls that are dragged, at least
_WHIP, _PATH, _GHOST = 0.007, 0.006, 0.003  # of the reach: radius of the whip, thickness of lines
_GREY = (130, 130, 130)
_GRID: dict[str, Any] = {"cell_size": 0.1, "section_size": 0.5, "shadow_opacity": 0.0}
_LINES = {False: ((228, 228, 228), (200, 200, 200)), True: ((45, 45, 45), (75, 75, 75))}  # of the grid; in the dark
_UPRIGHT = np.array([0.5**0.5, -(0.5**0.5), 0.0, 0.0])  # turns an image, whose y is downward, to stand along x


def rgb(color: str) -> tuple[int, int, int]:
    """Return a colour such as #0072B2 as three numbers up to 255."""
    r, g, b = (int(color[i : i + 2], 16) for i in (1, 3, 5))
    return r, g, b


class PageScene:
    """The scene of one user.

    Args:
        api: Scene of the user's page.
        model: Model that is shown.
        dragged: Function that is called with the target where the user has dragged it, and whether the drag begins.
        looks: Visual shapes of the base and of each link in their frames, (a + 1,), see `robot_looks`; None: the
            model's own shapes.
    """

    def __init__(
        self,
        api: SceneApi,
        model: Model,
        dragged: Callable[[Target, bool], None],
        looks: Sequence[Look] | None = None,
    ) -> None:
        self.api, self.model, self._dragged = api, model, dragged
        self.reach = model.reach
        self.target = Target((0.0,) * model.dimension)
        self.postures: ScenePostures | None = None
        self._grabbed = np.zeros(3)  # of the target's ball, from its centre [m]
        self._ghost: Shown | None = None
        self._heat: np.ndarray | None = None  # shares of the heat map that is shown
        self._whip: list[Any] = []
        self._lengths = np.zeros(0)
        self._nodes: dict[str, Any] = {}
        self._visible = {"heat": True, "spread": True, "ghost": True}
        api.reset()
        api.set_up_direction("+z")
        api.configure_default_lights(cast_shadow=False)
        self._add_ground()
        self.set_dark(False)
        self._links = self._add_links() if looks is None else [self._add_look(*each) for each in enumerate(looks)]

    def camera(self, aspect: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the position of the camera and the point that it looks at at first [m], (3,) each.

        Args:
            aspect: Width over height of the window; below 1 the panel covers its lower part.
        """
        tall = aspect < 1
        if self.model.dimension == 2:
            middle, away = np.array([0.0 if tall else 0.3, 0.0, 0.0]), np.array([0.0, -1.75, 0.0])
        else:
            middle, away = np.array([0.2, 0.05, 0.2]), np.array([0.5, -1.0, 0.4])
        away *= min(0.95 / aspect, 2.5) if tall else 1.0
        middle[2] -= 0.28 * float(np.linalg.norm(away)) if tall else 0.0
        return (middle + away) * self.reach, middle * self.reach

    def _add_ground(self) -> None:
        floor = default_floor(self.model.arm)
        flat = self.model.dimension == 2
        size = (6 if flat else 2) * math.ceil(self.reach)
        height = -0.6 * self.reach if floor is None else floor
        place = (0.0, 0.05 * self.reach, 0.0) if flat else (0.0, 0.0, height)  # in the plane behind everything
        self._ground = self.api.add_grid("/ground", size, size, plane="xz" if flat else "xy", position=place, **_GRID)

    def _add_links(self) -> list[Any]:
        nodes: list[Any] = []
        colors = [(90, 95, 105), (120, 126, 138)]
        for i, its in enumerate(shapes(self.model)):
            if not its:
                nodes.append(None)
                continue
            vertices, faces = joined([shape_mesh(shape) for shape in its])
            nodes.append(self.api.add_mesh_simple(f"/arm/{i}", vertices, faces, color=colors[i % 2], side="double"))
        return nodes

    def _add_look(self, number: int, look: Look) -> Any:
        """Add the visual shapes of the base, number 0, or of a link, below a frame that moves."""
        frame = self.api.add_frame(f"/arm/{number}", show_axes=False)
        for i, shape in enumerate(look):
            mesh, color = drawn_mesh(shape)
            r, g, b = (round(255 * x) for x in color)
            self.api.add_mesh_simple(f"/arm/{number}/{i}", *mesh, color=(r, g, b), side="double")
        return frame

    def show(self, shown: Shown, ghost: Shown | None) -> None:
        """Show a strike at a target, and the strike before it as a ghost."""
        self.postures = postures(shown.model, shown.trajectory)
        self.show_target(shown.settings.target, hit=shown.hit)
        self._show_path(shown)
        if ghost is not self._ghost:
            self._ghost = ghost
            self._show_ghost(ghost)

    def show_target(self, target: Target, *, hit: bool) -> None:
        """Show a target with its direction and cone."""
        self.target, place = target, upright(np.array(target.position))
        color = rgb(COLORS["green"] if hit else COLORS["vermilion"])
        radius, grip = target.hit_radius, _GRIP * self.reach
        for name, size, opacity in (("/target/hit", radius, 0.6), ("/target/grip", grip, 0.25)):
            ball = self._node(name, lambda n=name, s=size, o=opacity: self._ball(n, s, o))
            ball.radius, ball.color, ball.position = size, color, place
        self._nodes["/target/grip"].visible = grip > radius  # of a ball that is too small to be grasped
        self._show_direction(target, place)

    def _ball(self, name: str, radius: float, opacity: float) -> Any:
        ball = self.api.add_icosphere(name, radius, opacity=opacity, cast_shadow=False, receive_shadow=False)
        ball.on_drag(self._drag_target)
        return ball

    def _show_direction(self, target: Target, place: np.ndarray) -> None:
        names = ("/target/cone", "/target/arrow", "/target/turn")
        if target.direction is None:
            for name in names:
                self._remove(name)
            return
        direction = upright(np.array(target.direction))
        length, color = _HANDLE * self.reach, rgb(COLORS["blue"])
        cone = cone_mesh(place, direction, min(target.cone, 1.4), 0.8 * length)
        self._mesh("/target/cone", cone, color, 0.35)
        start = place - length * direction
        arrow = np.array([[start, place]], np.float32)
        thin = 0.004 * self.reach
        sizes = {"shaft_radius": thin, "head_radius": 2.5 * thin, "head_length": 6 * thin}
        node = self._node("/target/arrow", lambda: self.api.add_arrows("/target/arrow", arrow, color, **sizes))
        node.points = arrow
        turn = self._node("/target/turn", self._turning_ball)
        turn.position = start

    def _turning_ball(self) -> Any:
        ball = self.api.add_icosphere(
            "/target/turn", 0.8 * _GRIP * self.reach, rgb(COLORS["blue"]), cast_shadow=False, receive_shadow=False
        )
        ball.on_drag(self._drag_direction)
        return ball

    async def _drag_target(self, event: Any) -> None:
        if not np.isfinite([event.start_position, event.end_position]).all():  # as no browser sends it by itself
            return
        if event.phase == "start":
            self._grabbed = np.array(event.start_position) - upright(np.array(self.target.position))
        place = self._in_model(np.array(event.end_position) - self._grabbed)
        target = _moved(self.target, position=tuple(np.round(place, 4).tolist()))
        self._dragged(target, event.phase == "start")

    async def _drag_direction(self, event: Any) -> None:
        away = np.array(self.target.position) - self._in_model(np.array(event.end_position))
        if 1e-6 < np.linalg.norm(away) < np.inf:
            direction = away / np.linalg.norm(away)
            target = _moved(self.target, direction=tuple(np.round(direction, 6).tolist()))
            self._dragged(target, event.phase == "start")

    def _in_model(self, place: np.ndarray) -> np.ndarray:
        return place[[0, 2]] if self.model.dimension == 2 else place

    def _show_path(self, shown: Shown) -> None:
        points, colors = _path(shown)
        self._lines("/path", points, colors, _PATH)

    def _show_ghost(self, ghost: Shown | None) -> None:
        if ghost is None:
            self._remove("/ghost/path")
            self._remove("/ghost/whip")
            return
        before = postures(ghost.model, ghost.trajectory)
        self._lines("/ghost/path", _segments(before.whip[:, -1]), np.array(_GREY, np.uint8), _GHOST)
        whip = before.whip[before.at(float(ghost.near.time[0]))]
        self._lines("/ghost/whip", _segments(whip), np.array(_GREY, np.uint8), _GHOST)
        self._set_visible("ghost")

    def pose(self, index: int) -> None:
        """Show arm and whip at an instant of the strike."""
        if self.postures is None:
            return
        index = min(index, len(self.postures.t) - 1)
        for node, origin, turn in zip(
            self._links[1:], self.postures.origins[index], self.postures.quaternions[index], strict=False
        ):
            if node is not None:
                node.position, node.wxyz = origin, turn
        whip = zip(self._rods(), self.postures.whip[index], self.postures.rods[index], strict=False)
        for node, start, turn in whip:
            node.position, node.wxyz = start, turn

    def _rods(self) -> list[Any]:
        """Return the pieces of the whip; their poses, unlike the points of a line, are shown without delay."""
        assert self.postures is not None
        lengths = np.linalg.norm(np.diff(self.postures.whip[0], axis=0), axis=1)
        if len(lengths) != len(self._whip) or not np.allclose(lengths, self._lengths, rtol=1e-3):
            self._lengths, color = lengths, rgb(COLORS["orange"])
            self._whip = [
                self.api.add_mesh_simple(f"/whip/{i}", *rod_mesh(_WHIP * self.reach, length), color=color)
                for i, length in enumerate(lengths.tolist())
            ]
        return self._whip

    def show_heat(self, heat: HeatMap | None) -> None:
        """Show where the tip can hit, as an image in a vertical plane."""
        if heat is None:
            self._remove("/heat")
            return
        width, height = heat.high - heat.low
        along = np.array([math.cos(heat.azimuth), math.sin(heat.azimuth), 0.0])
        middle = (heat.low + heat.high) / 2
        place = middle[0] * along + np.array([0.0, 0.0, middle[1]])
        if self.model.dimension == 2:
            place[1] = 0.045 * self.reach
        half = heat.azimuth / 2
        turn = _product(np.array([math.cos(half), 0.0, 0.0, math.sin(half)]), _UPRIGHT)
        if "/heat" in self._nodes and self._heat is heat.shares:
            node = self._nodes["/heat"]
            node.position, node.wxyz = place, turn
            return
        self._heat = heat.shares
        self._nodes["/heat"] = self.api.add_image(
            "/heat", heat_image(heat), width, height, format="png", position=place, wxyz=turn,
            cast_shadow=False, receive_shadow=False, visible=self._visible["heat"],
        )  # fmt: skip

    def show_spread(self, spread: TipSpread | None) -> None:
        """Show the ellipses, or ellipsoids, that contain half and 95 % of the tip's errors."""
        for i, inside in enumerate(INSIDE):
            name = f"/spread/{i}"
            if spread is None:
                self._remove(name)
                continue
            axes = spread.scale(inside) * spread.axes
            color = rgb(COLORS["pink"])
            if len(spread.centre) == 2:
                line = upright(ellipse_points(spread.centre, axes)) - [0.0, 0.01 * self.reach, 0.0]
                self._lines(name, _segments(line), np.array(color, np.uint8), _GHOST)
            else:
                self._mesh(name, ellipsoid_mesh(spread.centre, axes), color, 0.4 if i == 0 else 0.18)
        self._set_visible("spread")

    def set_visible(self, what: str, visible: bool) -> None:
        """Show or hide the heat map (`heat`), the tolerance ellipses (`spread`) or the ghost (`ghost`)."""
        self._visible[what] = visible
        self._set_visible(what)

    def set_dark(self, dark: bool) -> None:
        """Draw the grid for a light or a dark background."""
        self._ground.cell_color, self._ground.section_color = _LINES[dark]

    def _set_visible(self, what: str) -> None:
        for name, node in list(self._nodes.items()):
            if name.startswith(f"/{what}"):
                node.visible = self._visible[what]

    def _node(self, name: str, add: Callable[[], Any]) -> Any:
        if name not in self._nodes:
            self._nodes[name] = add()
        return self._nodes[name]

    def _lines(self, name: str, points: np.ndarray, colors: np.ndarray, share: float) -> None:
        points, wide = points.astype(np.float32), share * self.reach
        colors = np.broadcast_to(colors, points.shape).astype(np.uint8)
        node = self._node(name, lambda: self.api.add_line_segments(name, points, colors, thickness=wide))
        if node.points.shape == points.shape:
            node.points = points
            if not np.array_equal(node.colors, colors):
                node.colors = colors
        else:
            self._nodes[name] = self.api.add_line_segments(name, points, colors, thickness=wide)

    def _mesh(self, name: str, mesh: Mesh, color: tuple[int, int, int], opacity: float) -> None:
        vertices, faces = mesh
        vertices = vertices.astype(np.float32)
        node = self._node(
            name,
            lambda: self.api.add_mesh_simple(
                name, vertices, faces, color=color, opacity=opacity, side="double",
                cast_shadow=False, receive_shadow=False,
            ),
        )  # fmt: skip
        node.vertices = vertices

    def _remove(self, name: str) -> None:
        node = self._nodes.pop(name, None)
        if node is not None:
            node.remove()


def _moved(target: Target, **changes: Any) -> Target:
    """Return a target with another position or direction."""
    return replace(target, **changes, sight=None)


def _segments(points: np.ndarray) -> np.ndarray:
    """Return a line through points (P, 3) as segments (P - 1, 2, 3)."""
    return np.stack([points[:-1], points[1:]], axis=1)


def _path(shown: Shown) -> tuple[np.ndarray, np.ndarray]:
    """Return the path of the tip as segments (S, 2, 3), and their colours (S, 2, 3): what is fast is dark."""
    path = shown.trajectory
    kept = np.linspace(0, len(path.t) - 1, min(240, len(path.t))).round().astype(int)
    points, speed = upright(path.tip[kept]), path.tip_speed[kept]
    shades = (255 * SPEED(speed / max(float(np.nanmax(speed)), 1e-9))[:, :3]).astype(np.uint8)
    return _segments(points), np.stack([shades[:-1], shades[1:]], axis=1)


LEAST, MOST = 2e-3, 0.2  # shares of strikes between which the colours of the heat map change


def heat_image(heat: HeatMap) -> np.ndarray:
    """Return a heat map as an image (rows, columns, 4), 0 to 255: clear where no strike passes."""
    with np.errstate(divide="ignore"):
        level = np.log(heat.shares / LEAST) / np.log(MOST / LEAST)
    image = matplotlib.colormaps["YlOrRd"](np.clip(level, 0.0, 1.0))
    image[..., 3] = np.where(heat.shares > 0, 0.4, 0.0)
    return (255 * np.repeat(np.repeat(image, 4, axis=0), 4, axis=1)).astype(np.uint8)


def _product(p: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Return the product of two quaternions, (4,) each, w first."""
    w, v = p[0] * q[0] - p[1:] @ q[1:], p[0] * q[1:] + q[0] * p[1:] + np.cross(p[1:], q[1:])
    return np.array([w, *v])
