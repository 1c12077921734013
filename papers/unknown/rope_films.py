"""Ropes as two calibrated cameras film them: rendered images, the tip tracked in each view, its places from both."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from papers.unknown.rope_swings import IN_SPACE, UnknownRope
from whiptool import Strike, StrikeRecording
from whiptool.recording.space_camera import SpaceCamera, looking_at
from whiptool.vision.space_view import SpaceView, track_view
from whiptool.vision.strike_in_space import strike_in_space

WATCHED = (-0.6, 0.7, -0.5)  # [m], where the tips are in wiggles
_PLACES = {"left": (1.4, 2.9, 0.0), "right": (-2.6, 2.9, 0.0)}  # [m]
_LENS = np.array([[430.0, 0.0, 424.0], [0.0, 430.0, 240.0], [0.0, 0.0, 1.0]])  # [pixels], of 848 x 480


def cameras() -> list[SpaceCamera]:
    """Return two cameras with global shutters, 60 frames a second of 2 ms each, as a D435 has for infrared."""
    found = []
    for name, place in _PLACES.items():
        turned = looking_at(place, WATCHED)
        found.append(SpaceCamera(name, 848, 480, _LENS, turned, np.array(place), fps=60.0, exposure=2e-3, readout=0.0))
    return found


def filmed(rope: UnknownRope, strike: Strike, number: int) -> StrikeRecording:
    """Return where the cameras saw the tip in a strike; their clock is the rope's; the same number has the same noise.

    Raises:
        InputError: A camera never saw the tip.
        WhiptoolError: There is no OpenGL.
    """
    from whiptool.vision.render import VirtualCamera

    model, path = rope.played(strike)
    views = []
    for i, camera in enumerate(cameras()):
        rng = np.random.default_rng([IN_SPACE.index(rope.family), rope.seed, number, i])
        virtual = VirtualCamera(SpaceView.of(camera), model, path, rng)
        views.append(track_view(virtual, strike=strike))
    seen, late = strike_in_space(views), rope.clock
    source = f"{rope.family}-{rope.seed}, filmed strike {number}"
    return replace(seen, t=seen.t + late, t_points=seen.t_points + late, source=source)
