"""The articulated-body algorithm in the plane, one link at a time, in CasADi.

Featherstone, Rigid Body Dynamics Algorithms (2008), ch. 7: axes stay parallel to the world's, moments are taken about
each link's own joint, and accelerations are those of material points, so that the only velocity term is centripetal.
A link's articulated inertia is then a symmetric 2x2 `M`, a 2-vector `h` and a scalar `J`.

`outward` goes from the base to the tip, `inward` back, `accelerate` to the tip again. What is given as the number 0
generates no term.
"""

from __future__ import annotations

from typing import NamedTuple

import casadi as ca

Scalar = ca.SX | float


class Link(NamedTuple):
    """A link's own numbers, and the drag on its far end; units as in `Chain`."""

    length: ca.SX
    mass: ca.SX
    com: ca.SX
    inertia: ca.SX
    drag: ca.SX
    drag_ratio: Scalar

    @property
    def is_point_mass(self) -> bool:
        """Whether the centre of mass is the same expression as the length: a point mass on a massless link."""
        return ca.is_equal(self.com, self.length)


class JointFrame(NamedTuple):
    """Where a link begins: absolute angle and speed of the link before it, velocity [m/s] and place [m]."""

    angle: Scalar = 0.0
    speed: Scalar = 0.0
    vx: Scalar = 0.0
    vy: Scalar = 0.0
    x: Scalar = 0.0
    y: Scalar = 0.0


class Moving(NamedTuple):
    """A moving link: from its joint to its far end (rx, ry) and to its centre of mass (cx, cy) [m], its squared
    angular speed, and the drag on its far end (fx, fy) [N]."""

    rx: Scalar
    ry: Scalar
    cx: Scalar
    cy: Scalar
    speed2: Scalar
    fx: Scalar
    fy: Scalar


class Carried(NamedTuple):
    """What a link carries: articulated inertia `M`, `h`, `J` and bias force (px, py) and moment pn about its end."""

    Mxx: Scalar = 0.0
    Mxy: Scalar = 0.0
    Myy: Scalar = 0.0
    hx: Scalar = 0.0
    hy: Scalar = 0.0
    J: Scalar = 0.0
    px: Scalar = 0.0
    py: Scalar = 0.0
    pn: Scalar = 0.0


class Acceleration(NamedTuple):
    """Of the point where a link begins [m/s^2], and the angular one of the link before it [rad/s^2]."""

    ax: Scalar = 0.0
    ay: Scalar = 0.0
    alpha: Scalar = 0.0


def outward(frame: JointFrame, q: ca.SX, v: ca.SX, link: Link) -> tuple[JointFrame, Moving]:
    """Return the frame at a link's far end and how the link moves, for its joint's position and velocity."""
    angle, speed = frame.angle + q, frame.speed + v
    sin, cos = ca.sin(angle), ca.cos(angle)
    rx, ry = link.length * sin, -link.length * cos
    vx, vy = frame.vx - speed * ry, frame.vy + speed * rx
    fx, fy = drag_force(link, vx, vy, sin, cos)
    cx, cy = (rx, ry) if link.is_point_mass else (link.com * sin, -link.com * cos)
    end = JointFrame(angle, speed, vx, vy, frame.x + rx, frame.y + ry)
    return end, Moving(rx, ry, cx, cy, speed**2, fx, fy)


def drag_force(link: Link, vx: Scalar, vy: Scalar, sin: ca.SX, cos: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Return the quadratic drag [N] on a link's far end of velocity (vx, vy), the link along (sin, -cos).

    A tiny constant keeps the root differentiable at rest.
    """
    if link.drag.is_zero():
        return ca.SX(0), ca.SX(0)
    size = ca.sqrt(vx**2 + vy**2 + 1e-12)
    less = (1 - ca.SX(link.drag_ratio)) * (vx * sin - vy * cos)  # of the velocity along the link, not braked
    return -link.drag * size * (vx - less * sin), -link.drag * size * (vy + less * cos)


def inward(carried: Carried, moving: Moving, link: Link) -> Carried:
    """Return what a link's joint carries: the link, and what it carries at its far end."""
    Mxx, Mxy, Myy, hx, hy, J, px, py, pn = carried
    x, y, cx, cy, speed2, fx, fy = moving
    if link.is_point_mass:  # joins what the end carries
        Mxx, Myy = Mxx + link.mass, Myy + link.mass
    Mrx, Mry = -Mxx * y + Mxy * x, -Mxy * y + Myy * x  # M r_perp, r_perp = (-y, x)
    bx = px - fx - speed2 * (Mxx * x + Mxy * y)
    by = py - fy - speed2 * (Mxy * x + Myy * y)
    pn = pn - y * bx + x * by - speed2 * (hx * x + hy * y)
    px, py = bx, by
    J = J - y * (Mrx + 2 * hx) + x * (Mry + 2 * hy) + link.inertia
    hx, hy = hx + Mrx, hy + Mry
    if not link.is_point_mass:
        mcx, mcy = link.mass * cx, link.mass * cy
        px, py = px - speed2 * mcx, py - speed2 * mcy
        J = J + mcx * cx + mcy * cy
        hx, hy = hx - mcy, hy + mcx
        Mxx, Myy = Mxx + link.mass, Myy + link.mass
    return Carried(Mxx, Mxy, Myy, hx, hy, J, px, py, pn)


class Joint(NamedTuple):
    """What a joint keeps for `accelerate`: (hx, hy) and J of what it carries, -1 / D and its own torque u.

    D is the diagonal term, J with the joint's armature. The sign keeps one division a joint: CasADi writes
    `h * (1 / D)` as a division `h / D`, `h * (-1 / D)` as a product.
    """

    hx: Scalar
    hy: Scalar
    J: Scalar
    negative_inverse: Scalar
    u: Scalar


def joint(carried: Carried, torque: ca.SX, armature: ca.SX) -> Joint:
    """Return what a joint keeps of what it carries, for its torque [N m] and its armature [kg m^2]."""
    return Joint(carried.hx, carried.hy, carried.J, ca.SX(-1) / (carried.J + armature), torque - carried.pn)


def share(carried: Carried, joint: Joint, armature: ca.SX) -> Carried:
    """Return what the link before feels of what a joint carries: the joint gives way."""
    Mxx, Mxy, Myy, hx, hy, J, px, py, pn = carried
    gx, gy, less = hx * joint.negative_inverse, hy * joint.negative_inverse, joint.u * joint.negative_inverse
    Mxx, Mxy, Myy = Mxx + gx * hx, Mxy + gx * hy, Myy + gy * hy
    px, py, pn = px - hx * less, py - hy * less, pn - J * less
    if armature.is_zero():
        return Carried(Mxx, Mxy, Myy, 0.0, 0.0, 0.0, px, py, pn)
    stays = -armature * joint.negative_inverse
    return Carried(Mxx, Mxy, Myy, hx * stays, hy * stays, J * stays, px, py, pn)


def joint_acceleration(at: Acceleration, joint: Joint) -> ca.SX:
    """Return a joint's acceleration [rad/s^2], where its link begins with the acceleration `at`."""
    return ca.SX(joint.hx * at.ax + joint.hy * at.ay + joint.J * at.alpha - joint.u) * joint.negative_inverse


def accelerate(at: Acceleration, qdd: ca.SX, moving: Moving) -> Acceleration:
    """Return the acceleration at a link's far end."""
    alpha = at.alpha + qdd
    ax = at.ax - alpha * moving.ry - moving.speed2 * moving.rx
    ay = at.ay + alpha * moving.rx - moving.speed2 * moving.ry
    return Acceleration(ax, ay, alpha)


def joint_together(
    carried: list[Carried], moving: list[Moving], torque: list[ca.SX], armature: list[ca.SX], block: ca.SX, base: ca.SX
) -> list[ca.SX]:
    """Return accelerations of the first joints, solved for together: `(inertia + block) qdd = u`.

    Args:
        carried, moving: Of each of these a links; no joint among them has given way.
        torque, armature: Of each joint.
        block: Added to their inertia [kg m^2], (a, a), symmetric or not.
        base: Upward acceleration of the resting base [m/s^2]: gravity.
    """
    a = len(carried)
    H, rhs = ca.SX(block), ca.SX.zeros(a)
    for j in range(a):
        of = carried[j]
        x = y = ca.SX(0)
        H[j, j] += of.J + armature[j]
        for i in reversed(range(j)):  # from joint i to joint j
            x, y = x + moving[i].rx, y + moving[i].ry
            inertia = of.J - y * of.hx + x * of.hy
            H[i, j] += inertia
            H[j, i] += inertia
        # the bias so far counts velocities beyond joint j; those before it move the joint itself
        bx, by = ca.SX(0), base
        for link in moving[:j]:
            bx, by = bx - link.speed2 * link.rx, by - link.speed2 * link.ry
        rhs[j] = torque[j] - of.pn - of.hx * bx - of.hy * by
    return ca.vertsplit(solve(H, rhs))


def solve(A: ca.SX, b: ca.SX) -> ca.SX:
    """Return x of `A x = b` by elimination without pivoting: for small matrices near a positive definite one."""
    A, b, n = ca.SX(A), ca.SX(b), b.numel()
    for i in range(n):
        for j in range(i + 1, n):
            factor = A[j, i] / A[i, i]
            A[j, i:] -= factor * A[i, i:]
            b[j] -= factor * b[i]
    for i in reversed(range(n)):
        b[i] = (b[i] - sum((A[i, j] * b[j] for j in range(i + 1, n)), ca.SX(0))) / A[i, i]
    return b
