"""Ask and tell: a lab with its own robot and its own control code asks for a strike, and tells what it recorded."""

from dataclasses import replace
from pathlib import Path

import numpy as np

import whiptool as wt
from whiptool.adaptation import Adapter, Options, default_prior

NOISE, FPS = 0.002, 100.0  # [m], [1/s] of this lab's motion capture


def robot(strike: wt.Strike, model: wt.Model, controller: wt.Controller) -> wt.StrikeRecording:
    """Move to `strike.q_i`, wait until the whip hangs still, strike, record. This swings another whip."""
    longer = replace(model, whip=replace(model.whip, l=0.081, m=0.0144))
    path = wt.ReferenceRollout(longer, controller).trajectory(strike, t_stay=0.3)
    t = np.arange(int(path.t[-1] * FPS)) / FPS  # [s] since the command began
    tip = np.stack([np.interp(t, path.t, x) for x in path.tip.T], axis=1)
    tip += NOISE * np.random.default_rng(len(t)).standard_normal(tip.shape)
    return wt.StrikeRecording(t, tip[:, None], ("tip",), sigma=np.array(NOISE), t_stay=0.3)


if __name__ == "__main__":
    model = wt.preset("lemon2024")  # your model of arm and whip
    controller = wt.Controller(wt.oiac_preset("table4")).reckoning_with(model)
    prior, options = default_prior(model, controller, whip="uniform"), Options(max_strikes=4)
    target = wt.Target((1.2, 0.1))
    adapter = Adapter(prior, target, options, Path("run"))  # it goes on where the folder ends, days later, too
    while (strike := adapter.ask()) is not None:
        print(adapter.tell(robot(strike, model, controller)))
    assert adapter.steps[-1].hit
