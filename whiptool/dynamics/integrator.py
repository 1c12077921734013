"""The integrators, joint by joint: Rosenbrock-W methods of second and third order, and Runge-Kutta's.

Verwer, Spee, Blom, Hundsdorfer (1999), SIAM J. Sci. Comput. 20(4), 1456-1480: `(1 - gamma h A) k1 = f(y)`, `(1 - gamma
h A) k2 = f(y + h k1) - 2 k1`, `y+ = y + 3/2 h k1 + 1/2 h k2`, of order 2 for any A. Here A contains only `-M^-1 G`, G
the joints' damping and the controller's velocity gain, so that a stage is one articulated-body pass with `gamma h G`
added to the mass matrix. With `w = k2 + 2 k1` the second stage reads `(M + gamma h G) w = F + 2 gamma h G k1`.

The method of third order has four stages `(1 - gamma h A) k_i = f(y + h sum a_ij k_j) + h A sum gamma_ij k_j`, and
weights of second order and its own: their difference is the error of a step. Each is the pass of the second stage
above, `(M + gamma h G) k_i = F + 2 gamma h G b_i` with `b_i = -sum gamma_ij k_j / (2 gamma)`, A being that of the
stage's own state. Such an A asks for one condition more than one that is the same for all stages,
`sum b_i c_i sum_j gamma_ij = 0`. ROS34PW2 misses it, and is of second order where the controller's gain grows with the
error; the coefficients here are those nearest to it that meet all nine, with the same gamma and stability function.

Where the drive's motion is given and the whip is not stiff at the step, the classical method of Runge and Kutta, of
fourth order, takes four stages without G: of a rope on a robot at 2 ms it has a hundredth of the error. With the next
step's first stage in place of its last it is of third order: their difference is the error of a step. The one step in
which the reference ends, where its jerk jumps, has an error of second order, unless a step ends there.
"""

from __future__ import annotations

import math

import casadi as ca

from whiptool.dynamics.chain import Chain

GAMMA = 1 - 1 / math.sqrt(2)  # L-stable
# near ROS34PW2 (Rang, Angermann 2005, BIT 45, 761-787); of third order for any A, also one of each stage's own
W_GAMMA = 0.43586652150845900
W_A = (
    (0.0, 0.0, 0.0, 0.0),
    (0.86007656406430936, 0.0, 0.0, 0.0),
    (0.82797973931405207, -0.11004647855982255, 0.0, 0.0),
    (0.0, 0.0, 1.0, 0.0),
)
W_STIFF = (  # gamma_ij, of which the diagonal is W_GAMMA
    (0.0, 0.0, 0.0, 0.0),
    (-0.86007656406430936, 0.0, 0.0, 0.0),
    (-0.88599266725305483, 0.05043946654533225, 0.0, 0.0),
    (0.23418392804962125, -1.21531070489318254, 0.54526025533510228, 0.0),
)
W_B = (0.23418392804962125, -1.21531070489318254, 1.54526025533510228, 0.43586652150845900)
W_SECOND = (0.37147725726750598, -0.08941051802173548, 0.5, 0.21793326075422950)  # the weights of second order
RUNGE_KUTTA = ((0.0, 1 / 6), (0.5, 1 / 3), (0.5, 1 / 3), (1.0, 1 / 6))  # where a stage is taken, and its weight


def damping_gain(chain: Chain, v: ca.SX) -> ca.SX:
    """Return the derivative of the joints' damping and smoothed friction torque by their speed [N m s/rad], (n, 1)."""
    smooth = ca.SX(chain.friction_velocity) ** 2
    square = v**2 + smooth
    # not square**1.5: a power is taken lane by lane, and would cost more than all else in a step
    return ca.SX(chain.damping) + ca.SX(chain.dry_friction) * smooth / (square * ca.sqrt(square))


def predicted(q: ca.SX, v: ca.SX, k1: ca.SX, h: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Return positions and velocities of the second stage, for accelerations k1 of the first and a step h [s]."""
    return q + h * v, v + h * k1


def followed(q: ca.SX, v: ca.SX, speed: ca.SX, k: ca.SX, h: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Return positions and velocities after a time h [s] with constant `speed` and acceleration k."""
    return q + h * speed, v + h * k


def advanced(q: ca.SX, v: ca.SX, k1: ca.SX, w: ca.SX, h: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Return positions and velocities after a step h [s], from the accelerations k1 and w of both stages."""
    return q + h * v + 0.5 * h**2 * k1, v + 0.5 * h * (k1 + w)
