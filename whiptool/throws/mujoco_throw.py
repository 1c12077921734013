"""Throws in MuJoCo: the thing is a body that an equality holds at the tip or hand, which is switched off at release."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from whiptool.dynamics.posture import start_posture
from whiptool.models.strike import AnyStrike
from whiptool.models.trajectory import Trajectory
from whiptool.rollout.mujoco_import import mujoco
from whiptool.rollout.mujoco_model import NODE_INERTIA, build_spec
from whiptool.rollout.reference import MujocoRods, ReferenceRollout
from whiptool.throws.flight import land
from whiptool.throws.rollout import ThrowRollout

AGREEMENT = 1e-3  # [m], of landing points in the two simulators
_STIFF = 2.0  # time constant of the equality, in steps: the least that MuJoCo recommends
_IMPEDANCE = (0.9999, 0.9999, 0.001, 0.5, 2)
_FIRM = 1e8  # [kg m^2 or kg], inertia of joints that are on their reference, next to which all else vanishes


class MujocoThrow(ReferenceRollout):
    """Simulator of one throw in MuJoCo.

    The thing has three degrees of freedom, gravity and quadratic drag. Until its release an equality of the kind
    `connect` holds it at the tip or hand.

    Args:
        throws: Simulator whose model, controller and thing are repeated.
        release_time: Time of the release [s]. Under a controller without control period it is the end of a step; else
            the thing is released at the next step, see `released`.
        timestep: Largest step [s]; default: that of `ReferenceRollout`.

    Attributes:
        released: Time at which the equality was switched off [s]; None: not yet.
    """

    def __init__(self, throws: ThrowRollout, release_time: float, *, timestep: float | None = None) -> None:
        super().__init__(throws.model, throws.controller, timestep=timestep)
        if release_time:
            self.timestep = release_time / max(1, np.ceil(release_time / self.timestep - 1e-9))
        self.throws, self.release_time = throws, release_time
        self.released: float | None = None
        integrator = self._mj.opt.integrator
        self._mj = self._spec().compile()
        self._mj.opt.integrator = integrator
        self._data = mujoco.MjData(self._mj)
        self._thing = self._mj.body("thing").id
        self._rods = self._rods and MujocoRods(throws.bare, self._mj)
        first = self._mj.body("whip1").id  # other than in the loaded model, if that has a body at the hand
        self._nodes, self._root = slice(first, first + throws.bare.whip.N), self._mj.body_rootid[first]
        self._friction = np.r_[self._friction, np.zeros(3)]
        if self.controller.prescribed:
            self._mj.dof_armature[: self.model.arm.n] = _FIRM
        self._drag = throws.bare.whip.per_node("drag")
        self._brakes, self.has_forces = bool(self._drag.any()), True

    def _spec(self) -> mujoco.MjSpec:
        """Return arm, whip and the thing, with the equality."""
        throws = self.throws
        spec = build_spec(throws.bare)
        flags = (mujoco.mjtDisableBit.mjDSBL_CONTACT, mujoco.mjtDisableBit.mjDSBL_LIMIT)
        spec.option.disableflags = int(flags[0] | flags[1])
        whip = throws.bare.whip
        if throws.place == "tip":
            holder, at = f"whip{whip.N}", [0.0, 0.0, -float(whip.per_node("l")[-1])]
        else:
            holder, at = "whip1", [0.0, 0.0, 0.0]  # where the first node turns about the hand
        body = spec.worldbody.add_body(
            name="thing", mass=throws.thing.mass, inertia=[NODE_INERTIA] * 3, explicitinertial=True
        )
        for name, axis in zip("xyz", np.eye(3), strict=True):
            body.add_joint(name=f"thing {name}", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis)
        tied = spec.add_equality(name="hold", type=mujoco.mjtEq.mjEQ_CONNECT, objtype=mujoco.mjtObj.mjOBJ_SITE)
        for number, (owner, place) in enumerate(((spec.body(holder), at), (body, [0.0, 0.0, 0.0]))):
            owner.add_site(name=f"held{number}", pos=place)
        tied.name1, tied.name2 = "held0", "held1"
        tied.solref, tied.solimp = [_STIFF * self.timestep, 1.0], _IMPEDANCE
        return spec

    def hang(self, q: np.ndarray) -> mujoco.MjData:
        mj, data = self._mj, self._data
        mujoco.mj_resetData(mj, data)
        start = start_posture(self.model, q[None])[0]
        data.qpos[:-3] = start if self._rods is None else self._rods.positions(start)
        data.eq_active[:], self.released = 1, None
        mujoco.mj_kinematics(mj, data)
        data.qpos[-3:] = data.site("held0").xpos
        return data

    def _leading_torque(self, wanted: np.ndarray) -> np.ndarray:
        # the torques of `ReferenceRollout` would lack the equality's force, which MuJoCo computes after them
        return _FIRM * wanted

    def coordinates(self) -> tuple[np.ndarray, np.ndarray]:
        if self._rods is not None:
            return super().coordinates()
        return self._data.qpos[:-3], self._data.qvel[:-3]

    def tip(self) -> tuple[np.ndarray, np.ndarray]:
        """Return position [m] and velocity [m/s] of the thing, (d,) each."""
        return self._data.qpos[-3:][self._axes], self._data.qvel[-3:][self._axes]

    def apply_forces(self, data: mujoco.MjData) -> None:
        super().apply_forces(data)
        velocity = data.qvel[-3:]
        data.xfrc_applied[self._thing, :3] = -self.throws.thing.drag * np.linalg.norm(velocity) * velocity

    def begin_step(self, t: float) -> None:
        if self.released is None and t >= self.release_time - 1e-9:
            self.released = t
            self._data.eq_active[:] = 0

    def throw(self, strike: AnyStrike | np.ndarray, *, until: float) -> Trajectory:
        """Return the trajectory of a throw up to a time [s] or little later, whose tip is the thing."""
        vector = self.one_vector(strike)
        end = np.ceil(max(until, vector[-1] + self.timestep) / self.timestep) * self.timestep
        return self.trajectory(vector, t_stay=end - vector[-1])


@dataclass(frozen=True)
class ThrowReplay:
    """A throw, repeated in MuJoCo.

    Args:
        offset: Landing point relative to the centre of the opening, (d,) [m]; None: the thing never came down through
            the opening's plane, or the simulation diverged.
        velocity: Velocity at the landing, (d,) [m/s]; None as above.
        difference: Distance from the landing point of the compiled simulator [m]; None as above, or if that has none.
        timestep: Time step [s].
        confirmed: Whether the distance is at most `AGREEMENT`, or the thing comes down in neither simulator.
        miss: Length of the offset as it counts, of a flight from where MuJoCo releases the thing [m]; None as above.
        diverged: Whether the simulation diverged.
    """

    offset: np.ndarray | None
    velocity: np.ndarray | None
    difference: float | None
    timestep: float
    confirmed: bool
    miss: float | None = None
    diverged: bool = False


def replay_throw(throws: ThrowRollout, strike: AnyStrike | np.ndarray, *, t_stay: float) -> ThrowReplay:
    """Repeat a throw in MuJoCo, with up to three times half the time step if the landing points differ."""
    at = float(throws.release_times(strike, t_stay=t_stay)[0])
    simulator, comes_down = MujocoThrow(throws, at), throws.landing(strike, t_stay=t_stay)[1] is not None
    for attempt in range(4):
        offset = velocity = difference = miss = None
        diverged = confirmed = False
        if attempt:
            simulator = MujocoThrow(throws, at, timestep=simulator.timestep / 2)
        until = at + float(throws.landings(strike, [at], t_stay=t_stay).time[0]) + 0.02
        path = simulator.throw(strike, until=until)
        diverged = path.diverged or simulator.released is None
        if diverged or simulator.released is None:
            continue
        landed = throws.landings(strike, [simulator.released], t_stay=t_stay)
        expected = landed.place
        assert expected is not None
        crossing = _crossing(path, throws, simulator.released)
        if crossing is None:
            confirmed = not comes_down
        else:
            offset, velocity = crossing
            miss = _miss(path, throws, simulator.released)
            difference = float(np.linalg.norm(offset - expected[0])) if comes_down else None
            confirmed = difference is not None and difference <= AGREEMENT
        if confirmed:
            break
    return ThrowReplay(offset, velocity, difference, simulator.timestep, confirmed, miss, diverged)


def _miss(path: Trajectory, throws: ThrowRollout, released: float) -> float:
    """Length of what counts of the landing of a thing that leaves the whip as in MuJoCo [m], see `land`."""
    i = int(np.argmax(path.t >= released))
    state = np.concatenate([path.tip[i], path.tip_velocity[i]])[None]
    centre = throws.opening.centres + throws.box.drift * path.t[i]
    opening, drag = replace(throws.opening, centres=centre), throws.thing.drag_per_mass
    return float(np.linalg.norm(land(state, opening, gravity=throws.model.gravity, drag=drag).offset))


def _crossing(path: Trajectory, throws: ThrowRollout, released: float) -> tuple[np.ndarray, np.ndarray] | None:
    """Return offset from the opening and velocity, (d,) each, where the thing last falls through its plane."""
    from scipy.interpolate import CubicHermiteSpline

    flown = path.t >= released
    t = path.t[flown]
    relative = path.tip[flown] - np.array(throws.box.position) - throws.box.drift * t[:, None]
    height = relative @ np.array(throws.box.normal)
    falls = np.flatnonzero((height[:-1] > 0) & (height[1:] <= 0))
    if len(falls) == 0:
        return None
    i = int(falls[-1])
    pair = slice(i, i + 2)
    rates = path.tip_velocity[flown][pair]
    curve = CubicHermiteSpline(t[pair], relative[pair], rates - throws.box.drift)
    low, high = t[pair]
    for _ in range(60):
        middle = (low + high) / 2
        if curve(middle) @ np.array(throws.box.normal) > 0:
            low = middle
        else:
            high = middle
    return curve(low), curve(low, 1) + throws.box.drift
