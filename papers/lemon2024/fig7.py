"""Fig. 7: mean reward per episode of the four learners."""

from __future__ import annotations

import dataclasses
from dataclasses import astuple

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from papers.context import Context
from papers.lemon2024.printed import DRAWN, EPISODES, RANDOM_EPISODES, REWARD_OF, TRIALS, compared
from papers.lemon2024.printed import TIMES_THE_REWARD as TIMES
from whiptool.comparison import Comparison
from whiptool.comparison.plan import LEARNERS
from whiptool.comparison.series import NAMES
from whiptool.comparison.trial_plots import plot_rewards
from whiptool.rl.settings import TrainingPlan
from whiptool.viz.report import Claim, Claims, Picture, Section, Table, Text, verdict_over
from whiptool.viz.style import STYLE
from whiptool.words import counted, times

LAST = 0.1  # share of the episodes over which a final reward is taken


def sections(context: Context) -> list[Section]:
    """Learning curves under every observation, final rewards, and the hyperparameters."""
    comparison = context.comparison
    units = [u for m in LEARNERS for o in comparison.observations for u in comparison.learner_units(m, o)]
    results = context.results(units, "fig7")
    curves: dict[str, dict[str, np.ndarray]] = {}
    for o in comparison.observations:
        curves[o] = {}
        for method in LEARNERS:
            rows = [results[u.key]["rewards"] for u in comparison.learner_units(method, o)]
            shortest = min(map(len, rows))  # training that diverged ends before
            curves[o][method] = np.array([row[:shortest] for row in rows])
    window = max(1, comparison.plan.episodes // 50)
    with matplotlib.rc_context(STYLE):
        figure = Figure((4.6 * len(curves) + 0.4, 4.2), layout="constrained")
        axes = figure.subplots(1, len(curves), sharey=True, squeeze=False)[0]
        for ax, (o, rewards) in zip(axes, curves.items(), strict=True):
            plot_rewards(
                ax,
                rewards,
                random_episodes=comparison.training(o).random_episodes,
                window=window,
                title=f"observation {o}",
            )
            ax.label_outer()
        figure.legend(*axes[0].get_legend_handles_labels(), loc="outside upper left", ncols=4)
    final = {o: {m: _final(rows) for m, rows in rewards.items()} for o, rewards in curves.items()}
    table = [["mean reward of the last tenth (least to most of the seeds)", *(f"observation {o}" for o in final)]]
    for method in LEARNERS:
        cells = [f"{f[method].mean():.1f} ({f[method].min():.1f} to {f[method].max():.1f})" for f in final.values()]
        table.append([NAMES[method], *cells])
    lengths = "; ".join(
        f"{counted(plan.episodes, 'episode')} of {counted(plan.trials, 'strike')}, "
        f"the first {plan.random_episodes} random (observation {', '.join(seen)})"
        for plan, seen in _together(comparison).items()
    )
    about = (
        f"Algorithm 1: {lengths}; {counted(comparison.seeds, 'seed')}. A strike's reward is 50 for a hit (Eq. 17). "
        "The learners' own exploring strikes are counted, as in the paper: this is what training yields, not what the "
        "trained policy's mean action would."
    )
    caption = (
        f"Mean reward per episode (Fig. 7): mean over seeds, running mean of {counted(window, 'episode')} (thick), its "
        "range over seeds (shaded), raw mean over seeds (thin)."
    )
    return [
        Section(
            "Fig. 7: rewards while learning",
            [
                Text(about),
                Picture(figure, caption),
                _printed(comparison, final),
                Table(table),
                Claims(claims(final)),
                *_settings(),
            ],
        )
    ]


def _printed(comparison: Comparison, final: dict[str, dict[str, np.ndarray]]) -> Table:
    """What the paper states about the curves, and ours."""
    theirs = {"episodes": EPISODES, "strikes in each": TRIALS, "random episodes": RANDOM_EPISODES}
    ours = [astuple(comparison.training(o)) for o in final]
    rows = [[what, f"{theirs[what]}", *(f"{x[i]}" for x in ours)] for i, what in enumerate(theirs)]
    rows += [
        [f"{NAMES[m]}, reward in the end", REWARD_OF.get(m, DRAWN), *(f"{f[m].mean():.1f}" for f in final.values())]
        for m in LEARNERS
    ]
    caption = "The paper prints no reward of Fig. 7, and none is read off the picture. Ours: mean of the last tenth."
    return compared(rows, caption, *(f"here, observation {o}" for o in final))


def _together(comparison: Comparison) -> dict[TrainingPlan, list[str]]:
    """Observations by the length of their training."""
    lengths: dict[TrainingPlan, list[str]] = {}
    for o in comparison.observations:
        lengths.setdefault(comparison.training(o), []).append(o)
    return lengths


def _final(rewards: np.ndarray) -> np.ndarray:
    """Mean reward over the last tenth of the episodes, (S,)."""
    return rewards[:, -max(1, round(LAST * rewards.shape[1])) :].mean(axis=1)


def claims(final: dict[str, dict[str, np.ndarray]]) -> list[Claim]:
    """The paper's statements about Fig. 7; `final` rewards by observation and method, (S,) each."""
    others = [m for m in LEARNERS if m != "sac"]
    said = "; ".join(f"{o}: " + ", ".join(f"{NAMES[m]} {f[m].mean():.1f}" for m in LEARNERS) for o, f in final.items())

    def beaten(f: dict[str, np.ndarray]) -> list[str]:
        """Those whose best seed stays below SAC's worst."""
        return [m for m in others if f["sac"].min() > f[m].max()]

    def ratio(f: dict[str, np.ndarray], other: str) -> float:
        """Infinite where there is nothing to divide by: a reward above zero against one that is not."""
        mine, theirs = float(f["sac"].mean()), float(f[other].mean())
        return mine / theirs if theirs > 0 else (np.inf if mine > 0 else 0.0)

    best = {f"observation {o}": len(beaten(f)) == len(others) for o, f in final.items()}
    why = "; ".join(
        f"{o}: every seed of SAC above every seed of {', '.join(NAMES[m] for m in beaten(f)) or 'none'}"
        for o, f in final.items()
    )
    thrice = {f"observation {o}": all(ratio(f, m) > TIMES for m in others) for o, f in final.items()}
    multiples = "; ".join(f"{o}: " + ", ".join(_times(ratio(f, m), f, m) for m in others) for o, f in final.items())
    return [
        Claim("SAC's reward is the highest of the four", "Fig. 7, Sect. 3.1.2", said, verdict_over(best), why),
        Claim(
            "SAC's reward is more than 3 times that of the others",
            "> 3 times (abstract)",
            said,
            verdict_over(thrice),
            multiples,
        ),
    ]


def _times(ratio: float, final: dict[str, np.ndarray], other: str) -> str:
    """SAC's reward as a multiple of another's, in words; without a multiple if a reward is not above zero."""
    if final[other].mean() > 0 and ratio > 0:
        return times(ratio, NAMES[other])
    return f"{final['sac'].mean():.1f} against {final[other].mean():.1f} of {NAMES[other]}, which has no multiples"


def _settings() -> list[Text | Table]:
    """Every hyperparameter, as it was used."""
    from whiptool.rl.settings import SETTINGS

    tables = {m: {f.name: getattr(SETTINGS[m](), f.name) for f in dataclasses.fields(SETTINGS[m])} for m in LEARNERS}
    names = list(dict.fromkeys(name for table in tables.values() for name in table))

    def cell(method: str, name: str) -> str:
        if name not in tables[method]:
            return ""
        value = tables[method][name]
        if value is None:
            return "0 or 0.99"
        return "-".join(map(str, value)) if isinstance(value, tuple) else f"{value:g}"

    rows = [["hyperparameter", *(NAMES[m] for m in LEARNERS)]]
    rows += [[name, *(cell(m, name) for m in LEARNERS)] for name in names]
    note = (
        "The paper prints the layers' sizes, the learning rates, and SAC's alpha; the rest are usual values. "
        "The discount is 0 where the observation shows the target, for there no trial depends on another, else 0.99. "
        "Eqs. 12 and 13 as printed are not DDPG and TD3; the cited algorithms are used."
    )
    return [Text(note), Table(rows)]
