"""A lab's own robot as a port: it strikes and films, and whiptool learns the whip and plans the next strike."""

from dataclasses import replace
from pathlib import Path

import numpy as np

import whiptool as wt
from whiptool.adaptation.adapter import Options
from whiptool.adaptation.loop import Adaptation
from whiptool.adaptation.prior import default_prior
from whiptool.adaptation.steps import Seen, seen_of
from whiptool.recording.strike_recording import StrikeRecording

T_STAY = 0.3  # [s] that the controller stays on and the camera films after the movement
FPS, NOISE = 60.0, 0.005  # [1/s], [m] of the camera
FASTEST = 40.0  # [rad/s] that this robot's joints bear


class LabRobot:
    """Stands for your robot, whip and camera: MuJoCo swings a whip that is longer and heavier than the model says."""

    def __init__(self, model: wt.Model, controller: wt.Controller) -> None:
        longer = replace(model, whip=replace(model.whip, l=0.081, m=0.0144))
        self._inside, self._rng = wt.ReferenceRollout(longer, controller), np.random.default_rng(0)

    def swing(self, strike: wt.Strike) -> tuple[np.ndarray, ...]:
        """Frame times (T,) [s] from the command's start, the tip in them (T, 2) [m], encoder times (S,) and angles (S,
        2) [rad]. Here your code moves the arm to `strike.q_i`, waits until all hangs still, and sends the command."""
        path = self._inside.trajectory(strike, t_stay=T_STAY)
        frames = np.arange(int(path.t[-1] * FPS) + 1) / FPS
        tip = np.stack([np.interp(frames, path.t, path.tip[:, i]) for i in range(2)], axis=1)
        return frames, tip + NOISE * self._rng.standard_normal(tip.shape), path.t, path.q[:, :2]


class LabPort:
    """What whiptool asks for: one method."""

    def __init__(self, robot: LabRobot, target: tuple[float, ...]) -> None:
        self.robot, self.target = robot, target

    def strike(self, strike: wt.Strike, number: int, folder: Path | None, believed: wt.Model | None = None) -> Seen:
        """Strike and film; what the robot must not do is refused, and the next plan is another one."""
        fastest = 1.875 * np.abs(np.subtract(strike.q_f, strike.q_i)).max() / strike.D  # of a minimum-jerk path
        if fastest > FASTEST:
            return Seen(None, None, refused=f"a joint would turn at {fastest:.0f} rad/s")
        frames, tip, encoders, angles = self.robot.swing(strike)
        recording = StrikeRecording(
            t=frames,
            points=tip[:, None],  # (frames, markers, 2); NaN where the marker was lost
            markers=("tip",),
            sigma=np.array(NOISE),  # as well as your tracker knows its own error
            joints_t=encoders,
            joints_q=angles,  # where the arm really stood when the strike began
            target=self.target,
            t_stay=T_STAY,
            source="lab robot",
        )
        return seen_of(recording, self.target)


if __name__ == "__main__":
    model = wt.preset("lemon2024")  # your model of arm and whip
    # gravity compensation goes on reckoning with these masses, whatever is learned of the whip
    controller = wt.Controller(wt.oiac_preset("table4")).reckoning_with(model)
    target = wt.Target((1.2, 0.1))
    port = LabPort(LabRobot(model, controller), target.position)
    prior = default_prior(model, controller, whip="uniform")
    steps = Adaptation(prior, port, target, Options(max_strikes=3, t_stay=T_STAY)).run()
    for step in steps:
        said = "a look at the hanging whip" if step.judged is None else f"{step.judged}, a hit: {step.hit}"
        print(f"strike {step.number}: {said}")
    assert steps[0].number == 0
    assert steps[-1].hit
