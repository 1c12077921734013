"""A driver for a robot of your own, here a simulated one: its joints follow commanded positions behind a lag."""

import numpy as np

import whiptool as wt
from whiptool.limits.all_limits import default_limits
from whiptool.models.joint_trajectory import JointTrajectory
from whiptool.rig.robots.robot import Payload, Record, Robot, Sample, Stop
from whiptool.rig.robots.robot_rig import RobotRig
from whiptool.rig.stops import SafetyError
from whiptool.rig.virtual_film import VirtualFilm

LAG = 0.01  # [s], time constant of the joints


class LaggingRobot(Robot):
    """Stands for your robot: replace the body of each method by calls of its interface."""

    rate = 500.0  # commanded positions per second

    def __init__(self, host: str, model: wt.Model) -> None:
        self.host, self.n, self.limits = host, model.arm.n, model.arm.joint_limits
        self._q = np.array([-1.5, -1.2, -0.2, -0.5, 2.0, 0.4])

    def connect(self) -> None:
        """Nothing to connect to."""

    def disconnect(self) -> None:
        """A real robot is stopped here, too."""

    def posture(self) -> np.ndarray:
        return self._q.copy()

    def set_payload(self, payload: Payload) -> None:
        print(f"{self.host}: the flange carries {payload.mass:.3f} kg at {payload.center[2]:.3f} m")

    def follow(self, trajectory: JointTrajectory, record: Record, stop: Stop) -> None:
        self.check_start(trajectory)
        for t, q_d in zip(trajectory.t, trajectory.q, strict=True):
            if (reason := stop()) is not None:
                raise SafetyError("signal", reason)  # a real robot is brought to rest before this
            v = (q_d - self._q) / LAG
            record(Sample(float(t), self._q, v, q_d))
            self._q = self._q + v / self.rate

    def recover(self) -> None:
        """This robot has no faults."""


if __name__ == "__main__":
    model = wt.preset("ur5e")
    strike = wt.Strike((-1.63, -1.07, -0.22, -0.49, 2.16, 0.42), (-2.17, -2.07, -0.33, -1.73, -0.35, 2.09), 1.5)
    film = VirtualFilm("points", model, np.random.default_rng(0))  # of a simulated whip on the robot's motion
    limits = default_limits(model, prescribed=True)
    rig = RobotRig(model, LaggingRobot("lab", model), limits=limits, film=film)
    struck = rig.strike(strike)
    q_d = np.array([strike.reference(t)[0] for t in struck.recording.joints_t])
    print(f"joints lag up to {np.abs(struck.recording.joints_q - q_d).max():.3f} rad behind the command")
    assert struck.run.fault is None
