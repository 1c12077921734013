"""How often the regions that `whiptool adapt` states for a whip's numbers hold the truth, where the model is right.

`python benchmarks/posterior.py [--quick] [--json]`. Whips drawn from the prior itself, truncated at the bounds of its
numbers, strike once at random; the tip is seen 60 times a second with 5 mm noise. Of the normal distribution that a fit
gives (linearised at the most probable whip), and of the weighted sample of `whiptool.adaptation.posterior_sample`: the
share of truths inside the joint 50 % and 95 % regions (highest density), and of single numbers inside their 95 %
intervals; effective draws of the sample.
"""

from __future__ import annotations

import argparse
import json
import sys
from typing import Any

import numpy as np
from scipy.stats import chi2, norm
from tqdm import tqdm

import whiptool as wt
from whiptool.adaptation.ports import TipPort
from whiptool.adaptation.posterior import update
from whiptool.adaptation.posterior_sample import log_posterior, sample_posterior
from whiptool.adaptation.prior import Belief, default_prior
from whiptool.adaptation.twins import Twin
from whiptool.models.strike import Strike, default_bounds

NOISE = 0.005  # [m]
_LATENCY = 0.001  # [s]


def drawn(prior: Belief, rng: np.random.Generator) -> np.ndarray:
    """Return numbers of a whip from the prior, all inside their bounds."""
    root = np.linalg.cholesky(prior.covariance)
    lower, upper = (np.array([getattr(v, end) for v in prior.variables]) for end in ("lower", "upper"))
    while True:
        z = prior.z + root @ rng.standard_normal(len(prior.z))
        if ((z > lower) & (z < upper)).all():
            return z


def case(prior: Belief, seed: int) -> dict[str, Any] | None:
    """Return where one truth lies in what is learned of it; None where its strike diverges or is refused."""
    rng = np.random.default_rng(seed)
    truth = drawn(prior, rng)
    plant = prior.at(truth)
    assert plant.controller is not None
    twin = Twin("kin", seed, plant.model, plant.controller, _LATENCY, prior.values(truth)["delay"], NOISE)
    lower, upper = default_bounds(plant.model.arm).box
    seen = TipPort(twin, (1.15, 0.0)).strike(Strike.from_vector(rng.uniform(lower, upper)), 1, None)
    if seen.recording is None:
        return None
    learned = update(prior, [seen.recording], seed=seed)
    if learned.refused:
        return None
    belief = learned.belief
    off = truth - belief.z
    density = log_posterior(prior, [seen.recording], learned.redundancy)(truth[None])[0]
    sample = sample_posterior(prior, [seen.recording], learned, rng=rng)
    values = prior.values(truth)
    ends = np.array([sample.interval(name) for name in prior.names])
    inside = [low <= values[name] <= high for name, (low, high) in zip(prior.names, ends, strict=True)]
    return {
        "normal": float(chi2(len(off)).cdf(off @ np.linalg.solve(belief.covariance, off))),
        "sampled": sample.level_of(density),
        "normal_single": float(np.mean(np.abs(off) <= norm.ppf(0.975) * np.sqrt(np.diag(belief.covariance)))),
        "sampled_single": float(np.mean(inside)),
        "effective": sample.effective,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    prior = default_prior(wt.preset("lemon2024"), wt.Controller(wt.oiac_preset("table4")))
    seeds = range(2 if options.quick else 60)
    cases = [case(prior, seed) for seed in tqdm(seeds, file=sys.stderr, disable=options.quick)]
    known = [x for x in cases if x is not None]
    table = {name: np.array([x[name] for x in known]) for name in known[0]}
    result: dict[str, Any] = {"whips": len(known), "left_out": len(cases) - len(known), "numbers": len(prior.names)}
    for way in ("normal", "sampled"):
        result[way] = {
            "joint_50": float(np.mean(table[way] <= 0.5)),
            "joint_95": float(np.mean(table[way] <= 0.95)),
            "single_95": float(np.mean(table[f"{way}_single"])),
        }
    result["effective_draws"] = float(np.median(table["effective"]))
    if options.json:
        print(json.dumps(result))
        return
    print(f"{result['whips']} whips ({result['left_out']} left out), {result['numbers']} numbers each")
    print(f"{'':10s}{'joint 50 %':>12s}{'joint 95 %':>12s}{'single 95 %':>12s}")
    for way in ("normal", "sampled"):
        print(f"{way:10s}" + "".join(f"{100 * x:10.0f} %" for x in result[way].values()))
    print(f"effective draws of the sample: {result['effective_draws']:.0f} (median)")


if __name__ == "__main__":
    main()
