"""A new arm in space: a rail with a hinge on it, a stick, and a rope; a strike in both simulators."""

import math

import numpy as np

from whiptool import CompiledRollout, Controller, Model, ReferenceRollout, Strike
from whiptool.impedance import ConstantImpedance
from whiptool.models import JointLimits, SpatialArm, SpatialLink
from whiptool.models.mount import with_stick
from whiptool.models.presets import rope

rail = SpatialLink(
    mass=3.0,
    com=(0.0, 0.0, 0.0),
    inertia=(0.02, 0.02, 0.02, 0.0, 0.0, 0.0),
    axis=(0.0, 1.0, 0.0),  # slides to the left
    position=(0.0, 0.0, 1.2),
    kind="prismatic",
    limits=JointLimits(position=(-0.4, 0.4)),
)
upper = SpatialLink(
    mass=1.0,
    com=(0.0, 0.0, -0.2),
    inertia=(0.01, 0.01, 0.002, 0.0, 0.0, 0.0),
    axis=(0.0, -1.0, 0.0),  # turns what hangs forward
    position=(0.1, 0.0, 0.0),
    limits=JointLimits(position=(-math.pi / 2, math.pi)),
)
arm = SpatialArm((rail, upper), joints=("rail", "hinge"), hand_position=(0.0, 0.0, -0.4))
model = Model(rope(10), with_stick(arm, length=0.3, mass=0.05), name="rail")

controller = Controller(ConstantImpedance(K=((900, 0), (0, 60)), B=((90, 0), (0, 6))), feedforward=True)
strike = Strike(q_i=(-0.2, -0.6), q_f=(0.2, 1.6), D=0.6)
target = np.array([1.2, 0.1, 1.3])
compiled = CompiledRollout(model, controller, timestep=1e-4).approach(strike, target)
reference = ReferenceRollout(model, controller).approach(strike, target)
print(f"compiled {compiled.distance[0]:.5f} m, MuJoCo {reference.distance[0]:.5f} m")
assert abs(compiled.distance[0] - reference.distance[0]) < 1e-4
