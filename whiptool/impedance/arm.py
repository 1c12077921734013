"""The arm in Pinocchio: inertia I(q), gravity Jacobians and gravity compensation (Eq. 3), in the plane and in space."""

from __future__ import annotations

import threading
from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from whiptool.models.kinematics import HandMotion
from whiptool.models.parameters import Model
from whiptool.models.spatial_arm import SpatialArm

_UPRIGHT = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])


def pinocchio_chain(
    length: np.ndarray, mass: np.ndarray, com: np.ndarray, inertia: np.ndarray, gravity: float
) -> pin.Model:
    """Return a planar chain of n links as a Pinocchio model in the x-y plane: joint axes along z, gravity along -y.

    Args:
        length: Length of each link [m], (n,).
        mass: Mass [kg], (n,).
        com: Distance of the centre of mass from the joint [m], (n,).
        inertia: Moment of inertia about the centre of mass [kg m^2], (n,).
        gravity: Gravity [m/s^2].
    """
    model = pin.Model()
    model.gravity.linear = np.array([0.0, -gravity, 0.0])
    parent, placement = 0, pin.SE3.Identity()
    for i in range(len(length)):
        joint = model.addJoint(parent, pin.JointModelRZ(), placement, f"joint{i + 1}")
        about_com = np.diag([0.0, 0.0, inertia[i]])
        model.appendBodyToJoint(joint, pin.Inertia(mass[i], np.array([0, -com[i], 0]), about_com), pin.SE3.Identity())
        _add_frame(model, f"com{i + 1}", joint, np.array([0.0, -com[i], 0.0]))
        parent, placement = joint, pin.SE3(np.eye(3), np.array([0.0, -length[i], 0.0]))
    _add_frame(model, "end", parent, placement.translation)
    return model


def pinocchio_arm(arm: SpatialArm, gravity: float) -> pin.Model:
    """Return an arm in space as a Pinocchio model; gravity [m/s^2] is along -z.

    The frames `com1`, ... are at the links' centres of mass, `end` is at the hand.
    """
    model = pin.Model()
    model.gravity.linear = np.array([0.0, 0.0, -gravity])
    parent = 0
    for i, link in enumerate(arm.links):
        kind = pin.JointModelRevoluteUnaligned if link.kind == "revolute" else pin.JointModelPrismaticUnaligned
        placement = pin.SE3(np.array(link.rotation), np.array(link.position))
        parent = model.addJoint(parent, kind(np.array(link.axis)), placement, f"joint{i + 1}")
        inertia = pin.Inertia(link.mass, np.array(link.com), link.inertia_matrix)
        model.appendBodyToJoint(parent, inertia, pin.SE3.Identity())
        _add_frame(model, f"com{i + 1}", parent, np.array(link.com))
    _add_frame(model, "end", parent, np.array(arm.hand_position), np.array(arm.hand_rotation))
    model.armature = arm.per_link("armature")
    return model


def _add_frame(
    model: pin.Model, name: str, joint: int, position: np.ndarray, rotation: np.ndarray | None = None
) -> None:
    placement = pin.SE3(np.eye(3) if rotation is None else rotation, position)
    model.addFrame(pin.Frame(name, joint, 0, placement, pin.FrameType.OP_FRAME))


class _Scratch(threading.local):
    """Where Pinocchio computes: its data of a model, of each thread its own."""

    def __init__(self, model: pin.Model) -> None:
        self.data = model.createData()


class Arm:
    """Inertia, gravity and kinematics of a model's arm with n joints, as control laws need them, by Pinocchio.

    The whip counts only as a weight at the hand, in `gravity_compensation`. Several threads may use one object.

    Args:
        model: Model with arm, whip and gravity.
    """

    def __init__(self, model: Model) -> None:
        arm = model.arm
        self.n, self._dimension = arm.n, model.dimension
        if isinstance(arm, SpatialArm):
            self._model = pinocchio_arm(arm, model.gravity)
        else:
            links = (arm.per_link(name) for name in ("length", "mass", "com", "inertia"))
            self._model = pinocchio_chain(*links, gravity=model.gravity)
        self._scratch = _Scratch(self._model)
        self._axes = np.eye(3) if model.dimension == 3 else _UPRIGHT  # of Pinocchio's in ours
        self._friction = arm.per_link("friction")
        self._frames = [self._model.getFrameId(f"com{i + 1}") for i in range(arm.n)] + [self._model.getFrameId("end")]
        self._masses = (*arm.per_link("mass").tolist(), float(model.whip.mass))
        self._loaded: dict[tuple[float, ...], tuple[pin.Model, _Scratch]] = {}

    @property
    def _data(self) -> pin.Data:
        return self._scratch.data

    def inertia(self, q: np.ndarray) -> np.ndarray:
        """Return the inertia matrix I(q) of the arm without whip at joint positions q (n,) [rad or m], (n, n), as in
        Eq. 7 [kg m^2; kg for a prismatic joint].
        """
        return pin.crba(self._model, self._data, np.asarray(q, float)).copy()

    def gravity_jacobians(self, q: np.ndarray) -> np.ndarray:
        """Return the Jacobians [m/rad] of the links' centres of mass and of the hand, (n + 1, 2, n), in space (n + 1,
        3, n).

        Rows are x, y (and z). For two joints they are J_s, J_e and J_w of Eq. 3.
        """
        pin.computeJointJacobians(self._model, self._data, np.asarray(q, float))
        pin.updateFramePlacements(self._model, self._data)
        world = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        jacobians = (pin.getFrameJacobian(self._model, self._data, frame, world) for frame in self._frames)
        return np.array([jacobian.reshape(6, -1)[: self._dimension] for jacobian in jacobians])  # (6,) for one joint

    def hand(self, q: np.ndarray) -> HandMotion:
        """Return position, orientation and Jacobian of the hand in the base's frame at joint positions q (n,).

        The plane of a planar arm is the vertical one of x and z.
        """
        pin.computeJointJacobians(self._model, self._data, np.asarray(q, float))
        pin.updateFramePlacements(self._model, self._data)
        end, world, A = self._frames[-1], pin.ReferenceFrame.LOCAL_WORLD_ALIGNED, self._axes
        pose = self._data.oMf[end]
        jacobian = pin.getFrameJacobian(self._model, self._data, end, world).reshape(2, 3, -1)
        return HandMotion(A @ pose.translation, A @ pose.rotation @ A.T, (A @ jacobian).reshape(6, -1))

    def gravity_compensation(self, q: np.ndarray, masses: Sequence[float] | None = None) -> np.ndarray:
        """Return the torques [N m; N for a prismatic joint], (n,), that hold the arm and the whip's weight at the hand
        (Eq. 3).

        Args:
            q: Joint positions [rad or m], (n,).
            masses: Masses of the links and, last, of the whip [kg], in place of the model's, (n + 1,).
        """
        carried = self._masses if masses is None else tuple(masses)
        if carried not in self._loaded:
            self._loaded[carried] = self._loaded_with(carried)
        model, scratch = self._loaded[carried]
        return pin.computeGeneralizedGravity(model, scratch.data, np.asarray(q, float)).copy()

    def _loaded_with(self, masses: tuple[float, ...]) -> tuple[pin.Model, _Scratch]:
        """The arm with other masses of its links, and a point mass at the hand."""
        model = pin.Model(self._model)
        joints = [*range(1, self.n + 1), self.n]
        for joint in joints[:-1]:
            model.inertias[joint] = pin.Inertia.Zero()
        for joint, frame, mass in zip(joints, self._frames, masses, strict=True):
            place = model.frames[frame].placement.translation
            model.inertias[joint] += pin.Inertia(mass, place, np.zeros((3, 3)))
        return model, _Scratch(model)

    def feedforward(self, q_d: np.ndarray, v_d: np.ndarray, a_d: np.ndarray) -> np.ndarray:
        """Torque [N m], (n,), that the arm without whip needs along the reference q_d, v_d, a_d (n,), without
        gravity."""
        with_gravity = pin.rnea(self._model, self._data, q_d, v_d, a_d)
        weight = pin.computeGeneralizedGravity(self._model, self._data, q_d)
        return with_gravity - weight + self._friction * v_d
