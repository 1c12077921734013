"""A hanging rope of links on hinges in MuJoCo, whose hand follows a path, and its fit by mujoco.sysid."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Sequence

import mujoco
import numpy as np
from mujoco import sysid
from scipy.interpolate import CubicHermiteSpline

from whiptool.models import WhipProfile

STEP, HEAVY = 1e-3, 1e6  # [s], [kg] of the hand


class MujocoRope:
    """The rope as a chain of point masses in the plane of x and z.

    Args:
        guess: Properties at which the fit starts.
        links: Number of links.
        markers: Numbers of the links at whose ends the rope is seen, (M,).
    """

    def __init__(self, guess: WhipProfile, links: int, markers: np.ndarray) -> None:
        self.guess, self.links, self.markers = guess, links, markers.tolist()

    def spec(self, stiffness: float, damping: float) -> mujoco.MjSpec:
        """The model with bending stiffness [N m^2] and damping [N m^2 s]; the hand's slides are moved by forces."""
        spec, link = mujoco.MjSpec(), self.guess.length / self.links
        spec.option.timestep, spec.option.integrator = STEP, mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        hand = spec.worldbody.add_body(name="hand", mass=HEAVY, inertia=[1, 1, 1], explicitinertial=True, gravcomp=1)
        for axis, direction in (("x", [1, 0, 0]), ("z", [0, 0, 1])):
            hand.add_joint(name=axis, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=direction)
            motor = spec.add_actuator(name=axis, target=axis, trntype=mujoco.mjtTrn.mjTRN_JOINT)
            motor.gainprm[0] = HEAVY
        body = hand
        for i in range(self.links):
            mass = self.guess.linear_density * link * (0.5 if i == self.links - 1 else 1)
            about = {"ipos": [0, 0, -link], "inertia": [1e-9] * 3, "explicitinertial": True}
            body = body.add_body(name=f"link{i + 1}", pos=[0, 0, -link if i else 0], mass=mass, **about)
            joint = body.add_joint(name=f"hinge{i + 1}", type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, -1, 0])
            put(joint, "stiffness", stiffness / link if i else 0.0)
            put(joint, "damping", damping / link if i else 0.0)
            if i + 1 in self.markers:
                site = body.add_site(name=f"marker{i + 1}", pos=[0, 0, -link])
                of = {"objtype": mujoco.mjtObj.mjOBJ_SITE, "objname": site.name}
                spec.add_sensor(name=site.name, type=mujoco.mjtSensor.mjSENS_FRAMEPOS, **of)
        return spec

    def control(self, hand: CubicHermiteSpline, end: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Times, accelerations that take the hand's steps exactly along its path, (T, 2), and its first velocity."""
        t = np.arange(0, end + 2 * STEP, STEP)
        place = hand(np.concatenate([[-STEP], t, [t[-1] + STEP]]).clip(0))[:, [0, 2]]
        return t, np.diff(place, 2, axis=0) / STEP**2, (place[1] - place[0]) / STEP

    def sequence(self, t: np.ndarray, hand: CubicHermiteSpline, seen: np.ndarray) -> sysid.ModelSequences:
        """One swing as mujoco.sysid takes it."""
        spec = self.spec(self.guess.bending_stiffness, self.guess.bending_damping)
        compiled = spec.compile()
        times, acceleration, _ = self.control(hand, float(t[-1]) + 0.01)
        q = np.concatenate([hand(0.0)[[0, 2]], np.zeros(self.links)])
        state = sysid.create_initial_state(compiled, q, 0 * q, np.zeros(0))
        measured = sysid.TimeSeries.from_names(t, seen.reshape(len(t), -1), compiled)
        return sysid.ModelSequences("rope", spec, "swing", state, sysid.TimeSeries(times, acceleration), measured)

    def fit(
        self, t: np.ndarray, hands: Sequence[CubicHermiteSpline], seen: np.ndarray, sigma: float
    ) -> tuple[list[float], list[tuple[float, float]]]:
        """Fitted stiffness and damping, and the 95 % intervals that mujoco.sysid calculates."""
        link, first = self.guess.length / self.links, (self.guess.bending_stiffness, self.guess.bending_damping)

        def change(field: str, value: float):
            def changed(spec, parameter):
                for i in range(1, self.links):
                    put(spec.joint(f"hinge{i + 1}"), field, float(np.exp(parameter.value[0])) * value / link)

            return changed

        parameters = sysid.ParameterDict()
        for name, value in zip(("stiffness", "damping"), first, strict=True):
            limits = {"min_value": -np.log(30), "max_value": np.log(30)}
            parameters.add(sysid.Parameter(name, nominal=0.0, modifier=change(name, value), **limits))

        def residual(params, predicted, measured, model, return_all, *, state):
            there = predicted.resample(measured.times)
            r = ((there.data - measured.data) / sigma).reshape(len(measured.times), -1, 3)[..., [0, 2]]
            return r.ravel(), there, there

        sequences = [self.sequence(t, hand, x) for hand, x in zip(hands, seen, strict=True)]
        function = sysid.build_residual_fn(models_sequences=sequences, modify_residual=residual)
        with contextlib.redirect_stdout(sys.stderr):
            found, result = sysid.optimize(
                initial_params=parameters, residual_fn=function, optimizer="mujoco", verbose=False
            )
        logs = found.as_vector()
        residuals = function(logs, found)[0]
        _, half = sysid.calculate_intervals(residuals, np.asarray(result.jac))
        ends = [np.array([x - y, x + y]) for x, y in zip(logs, np.ravel(half), strict=True)]
        values = [float(value * np.exp(x)) for value, x in zip(first, logs, strict=True)]
        return values, [tuple((value * np.exp(x)).tolist()) for value, x in zip(first, ends, strict=True)]

    def predicted(self, values: Sequence[float], t: np.ndarray, hand: CubicHermiteSpline) -> np.ndarray:
        """Places of the markers at times t (T,) in a swing, (T, M, 3) [m]."""
        model = self.spec(*values).compile()
        data = mujoco.MjData(model)
        times, acceleration, _ = self.control(hand, float(t[-1]) + 0.01)
        data.qpos[:2] = hand(0.0)[[0, 2]]
        found = []
        for a in acceleration:
            mujoco.mj_forward(model, data)
            found.append(data.sensordata.copy())
            data.ctrl[:] = a
            mujoco.mj_step(model, data)
        path = np.array(found)
        at = [np.interp(t, times, x) for x in path.T]
        return np.array(at).T.reshape(len(t), -1, 3)


def put(element, field: str, value: float) -> None:
    """Set a spring or damper of a joint; MuJoCo 4 keeps polynomials, the linear term first."""
    old = np.array(getattr(element, field), float)
    setattr(element, field, value if old.ndim == 0 else np.r_[value, np.zeros(old.size - 1)])
