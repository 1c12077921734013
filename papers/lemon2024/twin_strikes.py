"""Strikes on a twin that is not the model: planned on the model, struck behind the servos' protocol, filmed."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from whiptool import CompiledRollout, Controller, Model, Strike, StrikeRecording, default_bounds, oiac_preset
from whiptool.comparison import TargetScene
from whiptool.comparison.units import Unit
from whiptool.errors import WhiptoolError

TARGETS = ((1.2, 0.1), (1.1, -0.1), (1.25, -0.05))  # [m]; three, as in Fig. 9; the paper prints no coordinates
SLOW = 0.9  # [s], the shortest D
FIRST, NEXT = 768, 192  # strikes that the first and each further iteration tries on the model
SPREAD, SHRINK = (
    0.08,
    0.6,
)  # standard deviation around the last strike, in parts of the box; from iteration to iteration
MARGIN = 0.1  # of the motors' line that is kept free
SCALES, DRAG = {"whip.k": 1.25, "whip.b": 0.75, "whip.m": 1.2}, 5e-4  # of the twin's whip
RATE, SETTLE = 500.0, 2.0  # [1/s], [s]
LATENCY, CLOCK_OFFSET = 0.002, 0.003  # [s], there and back; of the camera


def controller() -> Controller:
    """OIAC as printed, held for a cycle: at this rate the preset `table4` is unstable."""
    return Controller(oiac_preset("printed"), control_period=1 / RATE)


def true_model(model: Model) -> Model:
    """The twin's whip: stiffer, less damped, heavier, in air. Its motors come on top (`HARDWARE`)."""
    scaled = {name: scale * x for name, x in model.parameters().items() for of, scale in SCALES.items() if of in name}
    truth = model.with_parameters(scaled)
    return dataclasses.replace(truth, whip=dataclasses.replace(truth.whip, drag=DRAG), name="twin")


@dataclass(frozen=True, kw_only=True)
class PlanUnit(Unit):
    """Strikes that the motors can make, iteration by iteration nearer to each target, found on the model."""

    scene: TargetScene
    iterations: int
    targets: int

    def run(self, folder: Path | None, threads: int | None) -> dict[str, Any]:
        """An evolution strategy: the best of random strikes, then the best of those around the last."""
        model = self.scene.model
        rollout, bounds = CompiledRollout(model, controller(), threads=threads), default_bounds(model.arm)
        lower, upper = np.array(bounds.lower), np.array(bounds.upper)
        lower[-1] = SLOW  # faster, few strikes are within the motors' line
        chosen = []
        for number, target in enumerate(TARGETS[: self.targets]):
            rng = np.random.default_rng(number)
            tried = rng.uniform(lower, upper, (FIRST, len(lower)))
            for iteration in range(self.iterations):
                if iteration:
                    spread = SPREAD * SHRINK ** (iteration - 1) * (upper - lower)
                    tried = np.clip(rng.normal(chosen[-1]["strike"], spread, (NEXT, len(lower))), lower, upper)
                strike = self._best(rollout, tried, np.array(target))
                chosen.append({"strike": strike.tolist(), "target": target})
        return {"strikes": chosen}

    def _best(self, rollout: CompiledRollout, tried: np.ndarray, target: np.ndarray) -> np.ndarray:
        """Of strikes (B, 2 n + 1) the one that comes closest and that the motors can make."""
        from whiptool.limits.arm_limits import XM430
        from whiptool.rig.loop_options import LoopOptions
        from whiptool.rig.rehearsal import rehearse

        loop = LoopOptions(rate=RATE, delay=LATENCY, t_stay=self.scene.t_stay)
        near = rollout.approach(tried, target, t_stay=self.scene.t_stay)
        within = XM430.keeping_free(MARGIN).violation_of_peaks(near) <= 0
        for i in np.argsort(near.distance):
            if not within[i]:
                continue
            strike = Strike.from_vector(tried[i])
            rehearsal = rehearse(rollout.model, rollout.controller, strike, loop)
            if rehearsal.refused is None:
                return tried[i]
        raise WhiptoolError(f"of {len(tried)} strikes at {tuple(target)} the motors can make none")


@dataclass(frozen=True, kw_only=True)
class TwinUnit(Unit):
    """One strike on the twin, through servos, images and tracker.

    Without images the tip's position has the error that they would have, and the twin stands at the start at once.
    """

    scene: TargetScene
    number: int
    strike: tuple[float, ...]
    target: tuple[float, ...]
    images: bool

    def run(self, folder: Path | None, threads: int | None) -> dict[str, Any]:
        """Strike; what camera and servos saw of it, and the visual miss distance [m]."""
        from whiptool.rig.emulator.motor import HARDWARE
        from whiptool.rig.emulator.physics import TwinTruth
        from whiptool.rig.loop_options import LoopOptions
        from whiptool.rig.session import TwinRig
        from whiptool.rig.stops import StrikeStopped

        rig = TwinRig(
            self.scene.model,
            controller(),
            truth=TwinTruth(
                true_model(self.scene.model),
                HARDWARE,
                command_delay=LATENCY / 2,
                sample_delay=LATENCY / 2,
                clock_offset=CLOCK_OFFSET,
                seed=self.number,
            ),
            camera="d435-infrared" if self.images else "points",
            target=self.target,
            options=LoopOptions(rate=RATE, settle=SETTLE, delay=LATENCY, t_stay=self.scene.t_stay),
            at_once=not self.images,
        )
        try:
            struck = rig.strike(Strike.from_vector(self.strike))
        except StrikeStopped as stopped:
            return {"fault": stopped.reason}
        r = struck.recording
        near = struck.approach(np.array(self.target))
        if r is None or near.diverged[0] or r.joints_t is None or r.joints_q is None:
            return {"fault": "the tip was not seen"}
        i = r.markers.index("tip")
        seen = np.isfinite(r.points[:, i, :2]).all(axis=1)
        return {
            "fault": None,
            "miss": float(near.distance[0]),
            "t": r.t_points[seen, i].tolist(),
            "tip": r.points[seen, i, :2].tolist(),
            "sigma": r.sigma[seen, i].tolist(),
            "exposure": r.exposure,
            "joints_t": r.joints_t.tolist(),
            "joints_q": r.joints_q.tolist(),
        }


def recording(unit: TwinUnit, result: dict[str, Any]) -> StrikeRecording:
    """What the unit's camera and servos saw."""
    return StrikeRecording(
        t=np.array(result["t"]),
        points=np.array(result["tip"])[:, None],
        markers=("tip",),
        sigma=np.array(result["sigma"])[:, None],
        exposure=result["exposure"],
        strike=Strike.from_vector(unit.strike),
        joints_t=np.array(result["joints_t"]),
        joints_q=np.array(result["joints_q"]),
        target=unit.target,
        t_stay=unit.scene.t_stay,
        source=unit.key,
    )
