"""Fig. 6: trials to the first hit of every method, and what decides who needs fewest."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from papers.context import Context
from papers.lemon2024.printed import SHARE_OF_TRIALS as SHARE
from papers.lemon2024.printed import TRIALS_OF, compared
from whiptool.comparison import Series, collect
from whiptool.comparison.plan import PAPER_METHODS
from whiptool.comparison.series import (
    CONVENTION_NOTE,
    NAMES,
    convention_table,
    difficulty_sentence,
    figure,
    main_table,
    percent,
    radius_table,
)
from whiptool.comparison.target_scene import words, zone_named
from whiptool.comparison.trial_plots import comparison_figures
from whiptool.rl.task import OBSERVATIONS
from whiptool.viz.report import Claim, Claims, Picture, Section, Table, Text, verdict_over
from whiptool.words import times

OFF_POLICY = ("sac", "td3", "ddpg")
SEARCHES = ("directl", "ga")


class Standings:
    """Every method of Fig. 6 under one observation: the learners', and the searches as they are.

    Args:
        series: At one hit radius, learners under one convention.
        observation: Observation of the learners.
    """

    def __init__(self, series: Sequence[Series], observation: str) -> None:
        self.of = {one.method: one for one in series if one.observation in ("", observation)}

    def fewer(self, one: str, other: str, *, share: float = 1.0) -> bool:
        """Whether `one` needs fewer trials than a share of those of `other`, beyond the 95 % interval of the ratio."""
        return self.of[one].needs_fewer(self.of[other], share=share)

    def ratio(self, one: str, other: str) -> float:
        """Of the mean trials."""
        return self.of[one].mean / self.of[other].mean

    def say(self, *methods: str) -> str:
        """Mean trials for people."""
        return ", ".join(f"{NAMES[m]} {figure(self.of[m].mean)}" for m in methods)


def sections(context: Context) -> list[Section]:
    """Table, bars, distributions, claims, and the explanation."""
    series = context.series("fig6")
    scene, comparison = context.comparison.scene, context.comparison
    figures = comparison_figures(series)
    main = [one for one in series if one.main and one.hit_radius == scene.radii[0]]
    standings = {o: Standings(main, o) for o in comparison.observations}
    plans = [comparison.training(o) for o in comparison.observations]
    strikes = [plan.episodes * plan.trials for plan in plans]
    training = " and ".join(f"{n:,}" for n in dict.fromkeys(strikes))
    about = (
        f"Mean trials until a target is hit (Eq. 21), of {scene.targets} at random, at most {scene.cap} each; one that "
        f"is never hit counts {scene.cap}, and lowers the share of hits. Searches start from scratch at every target. "
        f"Learners are trained once per seed, with {training} strikes, and then strike with their policy: the column "
        "of training trials is the price of their few trials afterwards. Intervals are of Student's t over seeds and "
        "over targets, on the logarithm of the misses before the hit; whether a method needs fewer trials than another "
        "is decided by the interval of the ratio of both at the same targets. DIRECT-L is deterministic and has one "
        "seed. A search goes on to the tightest hit radius, its time is of that."
    )
    return [
        Section(
            "Fig. 6: trials to hit, method by method",
            [
                Text(about),
                Text(f"The targets: {words(scene.zone)}. {difficulty_sentence(context.difficulty(comparison))}"),
                Table(main_table(series), CONVENTION_NOTE),
                Picture(figures["bars"], "Mean trials to the first hit, with 95 % intervals (Fig. 6)."),
                _printed(standings),
                Picture(figures["ecdf"], "Share of targets hit within a number of trials, all seeds together."),
                *([Table(radius_table(series), "Tighter hit radii.")] if len(scene.radii) > 1 else []),
                Claims(claims(standings)),
            ],
        ),
        Section(
            "What decides Fig. 6: what the policy sees, and what it does after a miss", _explanation(series, standings)
        ),
        *further_zones(context),
    ]


def _printed(standings: dict[str, Standings]) -> Table:
    """What the paper states about every bar, and the mean trials here."""
    rows = [[NAMES[m], TRIALS_OF[m], *(figure(s.of[m].mean) for s in standings.values())] for m in PAPER_METHODS]
    caption = (
        "Mean trials to the first hit (Eq. 21). The paper's text prints no height of a bar of Fig. 6, and none is read "
        "off the picture here; its text about them is given with what was measured."
    )
    return compared(rows, caption, *(f"here, observation {o}" for o in standings))


def further_zones(context: Context) -> list[Section]:
    """The comparison where one strike does not do for all targets: what the task asks for, and a table each."""
    asked = [["targets", "area [m^2]", "one and the same strike hits", "random strikes hit"]]
    tasks, parts = [context.comparison], []
    for name in context.zones:
        zone = zone_named(name, context.comparison.scene, context.store, quick=context.quick)
        task = context.elsewhere(zone)
        series = collect(task.units(), context.results(task.units(), f"fig6 {name}"))
        tasks.append(task)
        parts += [
            Table(main_table(series), f"Targets: {words(zone)}. {CONVENTION_NOTE}"),
            Picture(comparison_figures(series)["bars"], f"Mean trials to the first hit, with 95 % intervals: {name}."),
        ]
    for task in tasks:
        zone, found = task.scene.zone, context.difficulty(task)
        shares = (percent(found[key]) for key in ("one_strike_hits", "random_strikes_hit"))
        asked.append([words(zone), f"{zone.size:.3f}", *shares])
    if not parts:
        return []
    about = (
        "Where one strike hits nearly all targets, a policy needs no aim to hit at the first trial. Below, methods are "
        f"compared where it takes aim; the hit radius is {context.comparison.scene.radii[0]:g} m. The best single "
        "strike was searched for these very targets, so that its share is the most that striking without aim can hit, "
        "as far as the search found it."
    )
    return [Section("Fig. 6 where one strike does not do", [Text(about), Table(asked), *parts])]


def claims(standings: dict[str, Standings]) -> list[Claim]:
    """The paper's statements about Fig. 6, each tried under every observation."""

    def tried(test, *shown: str) -> tuple[dict[str, bool], str]:
        holds = {f"observation {o}": bool(test(s)) for o, s in standings.items()}
        said = "; ".join(f"{o}: {s.say(*shown)}" for o, s in standings.items())
        return holds, said

    others = tuple(m for m in PAPER_METHODS if m != "sac")

    def claim(text: str, paper: str, test, shown: Sequence[str], reason) -> Claim:
        holds, said = tried(test, *shown)
        why = "; ".join(f"{o}: {reason(s)}" for o, s in standings.items())
        return Claim(text, paper, said, verdict_over(holds), why)

    def against(one: str, rivals: Sequence[str]):
        def reason(s: Standings) -> str:
            level = [NAMES[m] for m in rivals if not s.fewer(one, m)]
            if not level:
                return "fewer than each, beyond the interval of the ratio"
            return f"not fewer than {', '.join(level)}, beyond the interval of the ratio"

        return reason

    return [
        claim(
            "SAC needs the fewest trials of the six",
            "Fig. 6, Sect. 3.1.2",
            lambda s: all(s.fewer("sac", m) for m in others),
            PAPER_METHODS,
            against("sac", others),
        ),
        claim(
            "SAC needs less than 20 % of the trials of each of the others",
            "< 20 % (abstract)",
            lambda s: all(s.fewer("sac", m, share=SHARE) for m in others),
            ("sac",),
            lambda s: ", ".join(
                f"{100 * s.ratio('sac', m):.0f} % of {NAMES[m]}"
                + (" (not beyond the interval)" * (s.ratio("sac", m) < SHARE and not s.fewer("sac", m, share=SHARE)))
                for m in others
            ),
        ),
        claim(
            "SAC, TD3 and DDPG need fewer trials than DIRECT-L and GA",
            "Sect. 3.1.2",
            lambda s: all(s.fewer(m, x) for m in OFF_POLICY for x in SEARCHES),
            (*OFF_POLICY, *SEARCHES),
            lambda s: "; ".join(f"{NAMES[m]} {against(m, SEARCHES)(s)}" for m in OFF_POLICY),
        ),
        claim(
            "PPO does not need fewer trials than DIRECT-L and GA",
            "Sect. 3.1.2",
            lambda s: not any(s.fewer("ppo", m) for m in SEARCHES),
            ("ppo", *SEARCHES),
            lambda s: ", ".join(f"{100 * s.ratio('ppo', m):.0f} % of {NAMES[m]}" for m in SEARCHES),
        ),
        claim(
            "PPO needs more trials than SAC, TD3 and DDPG",
            "Sects. 3.1.2, 4.1",
            lambda s: all(s.fewer(m, "ppo") for m in OFF_POLICY),
            ("ppo", *OFF_POLICY),
            lambda s: ", ".join(times(s.ratio("ppo", m), NAMES[m]) for m in OFF_POLICY),
        ),
        claim(
            "TD3 and DDPG need about the same number of trials (between half and double)",
            "Sect. 4.1",
            lambda s: s.fewer("td3", "ddpg", share=2) and s.fewer("ddpg", "td3", share=2),
            ("td3", "ddpg"),
            lambda s: times(s.ratio("td3", "ddpg"), "DDPG"),
        ),
    ]


def _explanation(series: Sequence[Series], standings: dict[str, Standings]) -> list[Text | Table]:
    radius = series[0].hit_radius
    sac = {(one.observation, one.convention): one for one in series if one.method == "sac" and one.hit_radius == radius}
    others = [m for m in next(iter(standings.values())).of if m != "sac"]
    ratios = [["SAC's mean trials over those of", *(NAMES.get(m, m) for m in others)]]
    for observation, s in standings.items():
        ratios.append([f"observation {observation}", *(f"{s.ratio('sac', m):.3f}" for m in others)])
    said = {
        "tip": "sees only where the tip of the last strike came closest and how fast it was, never the target; "
        "before the first strike it sees the same for every target, so that its first strike is the same for all",
        "relative": "sees the same measured from the target, so that the first look at the resting whip tells "
        "where that is",
        "goal": "sees the target and the tip",
    }
    lines = []
    for observation in (o for o in OBSERVATIONS if o in standings):
        first = sac[observation, "mean-first"]
        share = float(np.mean(first.hit & (first.trials == 1)))
        stuck = sac[observation, "mean"]
        lines.append(
            Text(
                f"With observation {observation} the policy {said[observation]}. SAC's first strike hits "
                f"{percent(share)} of the targets. After misses, samples of its policy bring the mean to "
                f"{figure(first.mean)} trials ({percent(first.hit.mean())} hit); had it struck with its "
                f"mean action again and again, it would be {figure(stuck.mean)} "
                f"({percent(stuck.hit.mean())} hit), with samples from the first strike on "
                f"{figure(sac[observation, 'samples'].mean)}."
            )
        )
    random = next(iter(standings.values())).of["random"]
    lines.append(
        Text(
            f"Random strikes hit after {figure(random.mean)} trials on average, without any learning or search. "
            "A method that sees the target can come to one trial; between two that do, no ratio tells a difference."
        )
    )
    conventions = (
        "All learners, by what the policy does: mean action first and samples after a miss; samples from the first "
        "strike on; the mean action always."
    )
    return [
        *lines,
        Table(ratios, "Ratios of mean trials to the first hit; learners under the same observation."),
        Table(convention_table(series), conventions),
    ]
