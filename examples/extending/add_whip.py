"""A new whip: a leather whip given as a profile, from a TOML file, with any number of nodes."""

import tempfile
from pathlib import Path

import numpy as np

import whiptool as wt
from whiptool.models.files import read_model, write_model

TOML = """
name = "leather"
[whip]
N = {N}
[whip.profile]
length = 0.9
linear_density = 0.2
bending_stiffness = 0.02
bending_damping = 0.007
density_taper = 0.3
stiffness_taper = 0.1
damping_taper = 0.1
drag = 0.002
[arm]
links = [{{mass = 0.25, length = 0.31}}, {{mass = 0.274, length = 0.34}}]
"""


def tip_path(folder: Path, N: int, strike: wt.Strike) -> np.ndarray:
    """Path of the tip of the whip with N nodes at 100 samples a second [m], (S, 2)."""
    file = folder / f"leather-{N}.toml"
    file.write_text(TOML.format(N=N), encoding="utf-8")
    rollout = wt.CompiledRollout(wt.load_model(str(file)), wt.Controller(wt.ConstantImpedance()))
    return rollout.tip_path(strike.vector[None], t_stay=0.3, rate=100.0)[1][0]


if __name__ == "__main__":
    strike = wt.Strike(q_i=(-1.36, 0.47), q_f=(1.73, 1.41), D=0.95)
    with tempfile.TemporaryDirectory() as name:
        coarse, fine = (tip_path(Path(name), N, strike) for N in (12, 24))
        model = read_model(Path(name) / "leather-12.toml")
        write_model(model, Path(name) / "lumped.toml")  # the numbers of every node
        assert read_model(Path(name) / "lumped.toml") == model
    apart = np.hypot(*(coarse - fine).T)
    assert np.median(apart) < 0.05
    print(f"whip of {model.whip.length:.2f} m and {1e3 * model.whip.mass:.0f} g, first and last node")
    print(f"{1e3 * model.whip.per_node('m')[0]:.1f} g and {1e3 * model.whip.per_node('m')[-1]:.1f} g;")
    print(f"tips of 12 and 24 nodes are {100 * np.median(apart):.1f} cm apart (median over the strike)")
