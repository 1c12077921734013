"""A whip and an arm that no code of ours made: tapered capsules in MuJoCo, driven by a controller written anew.

Nothing here comes from `whiptool`'s models, controllers or rollouts, only the form of a strike and of a recording.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from whiptool.adaptation.steps import Seen, seen_of
from whiptool.models.parameters import Model
from whiptool.models.strike import Strike
from whiptool.recording.strike_recording import StrikeRecording

FRICTION = 0.004  # [N m s/rad] of the arm's joints
ARM = (0.31, 0.34)  # [m], as everybody can measure
BELIEVED = (0.25, 0.274, 0.144)  # [kg] of upper arm, forearm and whip, in the owner's gravity compensation
GRAVITY, FPS, STEP = 9.81, 60, 2e-4
SETTLING, COARSE = 2.0, 1e-3  # [s] that the arm holds its start before a strike, and MuJoCo's step then


@dataclass(frozen=True)
class ForeignWhip:
    """What its owner does not know.

    Args:
        length: [m]
        thick, thin: Radius at the handle and at the tip [m].
        density: [kg/m^3]
        stiffness: EI at the handle [N m^2]; it falls with the cube of the radius.
        loss: Damping over stiffness [s].
        friction: Dry friction of every joint [N m].
        first: Stiffness of the first joint, which is straight along the forearm [N m/rad].
        masses: Of upper arm and forearm [kg].
        gain: Of the motors, over what the controller asks for.
        late: The camera's clock [s].
    """

    length: float = 0.80
    thick: float = 0.0085
    thin: float = 0.005
    density: float = 980.0
    stiffness: float = 0.022
    loss: float = 0.30
    friction: float = 2e-4
    first: float = 0.02
    masses: tuple[float, float] = (0.262, 0.266)
    gain: float = 1.04
    late: float = 0.004

    def xml(self, links: int = 40) -> str:
        """MJCF of arm and whip; hinges turn about -y, so that a positive angle turns towards +x."""
        piece, nested, closing = self.length / links, "", ""
        for i in range(links):
            radius = self.thick + (self.thin - self.thick) * (i + 0.5) / links
            bend = self.first if i == 0 else self.stiffness * (radius / self.thick) ** 3 / piece
            place = -ARM[1] if i == 0 else -piece
            nested += f"""<body pos="0 0 {place:.9g}">
            <joint axis="0 -1 0" stiffness="{bend:.9g}" damping="{self.loss * bend:.9g}"
              frictionloss="{self.friction}"/>
            <geom type="capsule" fromto="0 0 0 0 0 {-piece:.9g}" size="{radius:.9g}" density="{self.density}"/>"""
            closing += "</body>"
        upper, fore = (f'fromto="0 0 0 0 0 {-x}" size="0.02" mass="{m}"' for x, m in zip(ARM, self.masses))
        return f"""<mujoco><compiler angle="radian"/>
        <option timestep="{STEP}" gravity="0 0 {-GRAVITY}" density="1.2" viscosity="1.8e-5" integrator="implicitfast">
        <flag contact="disable"/></option>
        <worldbody><body><joint name="shoulder" axis="0 -1 0" /><geom type="capsule" {upper}/>
        <body pos="0 0 {-ARM[0]}"><joint name="elbow" axis="0 -1 0" /><geom type="capsule" {fore}/>
        {nested}<site name="tip" pos="0 0 {-piece:.9g}"/>{closing}</body></body></worldbody>
        <actuator><motor joint="shoulder"/><motor joint="elbow"/></actuator></mujoco>"""


def reference(strike: Strike, t: float) -> tuple[np.ndarray, np.ndarray]:
    """Minimum jerk (Eq. 1): position [rad] and velocity [rad/s]; at rest before and after.

    A strike may have more movements `added` to it: when each begins, how long it lasts [s], and by how much [rad].
    """
    q_i, q_f = np.array(strike.q_i), np.array(strike.q_f)
    position, velocity = q_i, 0.0 * q_i
    for since, lasts, by in [(0.0, strike.D, q_f - q_i), *getattr(strike, "added", ())]:
        s = min(max((t - since) / lasts, 0.0), 1.0)
        position = position + by * s**3 * (10 - 15 * s + 6 * s**2)
        velocity = velocity + by * 30 * s**2 * (1 - s) ** 2 / lasts
    return position, velocity


def held_up(q: np.ndarray) -> np.ndarray:
    """Torque that carries the weights that the owner believes in, all of the whip at the hand (Eq. 3) [N m]."""
    upper, fore, whip = BELIEVED
    first, second = np.sin(q[0]), np.sin(q[0] + q[1])
    elbow = GRAVITY * ARM[1] * (fore / 2 + whip) * second
    return np.array([GRAVITY * ARM[0] * (upper / 2 + fore + whip) * first + elbow, elbow])


def torque(strike: Strike, t: float, q: np.ndarray, v: np.ndarray, *, a: float) -> tuple[np.ndarray, float]:
    """The paper's law (Eqs. 2, 8-10) with beta = 0.6 and C = 5 [N m], and how steeply it falls with the velocity
    [N m s/rad], at most."""
    q_d, v_d = reference(strike, t)
    e, de = q_d - q, v_d - v
    eps = e + 0.6 * de
    growth, squares = 1 + 5.0 * (eps @ eps), e @ e + de @ de
    F = eps * growth / a
    steepest = 0.6 * growth * squares + 2 * math.sqrt((eps @ eps) * (de @ de)) * growth + 6 * squares * (eps @ eps)
    return np.outer(F, e) @ e + np.outer(F, de) @ de + held_up(q), steepest / a


class ForeignPort:
    """A port of the foreign whip: its tip, 60 times a second with 5 mm noise, and the joints at 500 Hz.

    Args:
        whip: What is struck with.
        target: [m]
        joints: Whether the recording holds the joints that encoders measured.
        a: Of the law.
        noise: Standard error of a filmed point [m].
    """

    t_stay = 0.3

    def __init__(
        self,
        whip: ForeignWhip,
        target: tuple[float, float],
        *,
        joints: bool = True,
        a: float = 1.3e-4,
        noise: float = 0.005,
    ) -> None:
        self.whip, self.target, self.joints, self.a, self.noise = whip, target, joints, a, noise
        self._mj = mujoco.MjModel.from_xml_string(whip.xml())
        self._tip = self._mj.site("tip").id
        self.rested: dict[tuple[float, ...], np.ndarray] = {}

    def strike(self, strike: Strike, number: int, folder: Path | None, believed: Model | None = None) -> Seen:
        """As `whiptool.adaptation.steps.Port.strike`."""

        t, tip, q = self.moved(strike)
        true = float(np.linalg.norm(tip - self.target, axis=1).min())
        frames = np.arange(int(t[-1] * FPS) + 1) / FPS
        rng = np.random.default_rng([7, number])
        points = np.stack([np.interp(frames, t, tip[:, i]) for i in range(2)], axis=1)
        points += self.noise * rng.standard_normal(points.shape)
        every = slice(None, None, round(0.002 / STEP))
        recording = StrikeRecording(
            t=frames + self.whip.late,
            points=points[:, None],
            markers=("tip",),
            sigma=np.full((1, 1), self.noise),
            strike=strike,
            joints_t=t[every] if self.joints else None,
            joints_q=q[every] if self.joints else None,
            target=self.target,
            t_stay=self.t_stay,
            source=f"foreign, strike {number}",
        )
        return seen_of(recording, self.target, true_miss=true)

    def moved(self, strike: Strike) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Times (S,) [s], the tip (S, 2) [m] and the arm's joints (S, 2) [rad] of a strike from where the arm rests."""
        data = mujoco.MjData(self._mj)
        data.qpos[:] = self._rest(strike)
        steps = round((strike.D + self.t_stay) / STEP)
        tip, q = np.empty((steps + 1, 2)), np.empty((steps + 1, 2))
        for k in range(steps + 1):
            q[k] = data.qpos[:2]
            self._step(data, strike, k * STEP)
            tip[k] = data.site_xpos[self._tip, ::2]  # of before the step
        return STEP * np.arange(steps + 1), tip, q

    def _rest(self, strike: Strike) -> np.ndarray:
        """Where arm and whip have come to rest before a strike: the arm sags a little."""
        if strike.q_i not in self.rested:
            data = mujoco.MjData(self._mj)
            data.qpos[:3] = [*strike.q_i, -sum(strike.q_i)]
            hold = Strike(strike.q_i, strike.q_i, 1.0)
            self._mj.opt.timestep = COARSE
            for _ in range(round(SETTLING / COARSE)):
                self._step(data, hold, 0.0)
            self._mj.opt.timestep = STEP
            self.rested[strike.q_i] = data.qpos.copy()
        return self.rested[strike.q_i]

    def _step(self, data: mujoco.MjData, strike: Strike, t: float) -> None:
        """One step; the law's own damping enters as the joints', which MuJoCo integrates implicitly."""
        v = data.qvel[:2].copy()
        wanted, steepest = torque(strike, t, data.qpos[:2], v, a=self.a)
        self._mj.dof_damping[:2] = FRICTION + self.whip.gain * steepest
        data.ctrl[:] = self.whip.gain * (wanted + steepest * v)
        mujoco.mj_step(self._mj, data)
