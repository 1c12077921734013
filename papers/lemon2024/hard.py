"""The hard task, which the paper did not try: a hit radius of 1 cm, everywhere the tip can be fast."""

from __future__ import annotations

import dataclasses

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from papers.context import Context
from whiptool.comparison import LearnerUnit, SearchUnit, TargetScene, collect
from whiptool.comparison.plan import CHUNK, deterministic
from whiptool.comparison.series import main_table
from whiptool.comparison.target_scene import QUICK_STRIKES, SPEED, STRIKES, fast_region
from whiptool.goals.zone import Region
from whiptool.viz.report import Picture, Section, Table, Text
from whiptool.viz.style import COLORS, STYLE
from whiptool.words import counted

HIT_RADIUS = 0.01  # [m]
SEARCHES = ("directl", "ga", "cmaes", "gradient", "random")
LIBRARY = 20_000  # strikes: as many as the learner trains on


def sections(context: Context) -> list[Section]:
    """The region's map, and trials to hit for searches, cold and from a library, and for SAC with hindsight."""
    quick, base = context.quick, context.comparison.scene
    region = fast_region(base, context.store, quick=quick)
    scene = dataclasses.replace(base, zone=region, radii=(HIT_RADIUS,), targets=20 if quick else 300)
    library = 300 if quick else LIBRARY
    seeds = range(1 if quick else context.comparison.seeds)
    methods = [(method, warm) for warm in (0, library) for method in SEARCHES] + [("library", library)]
    units: list[SearchUnit | LearnerUnit] = [
        SearchUnit(scene=scene, method=m, seed=seed, first=first, last=min(first + CHUNK, scene.targets), library=warm)
        for m, warm in methods
        for seed in (seeds if warm or not deterministic(m) else [0])
        for first in range(0, scene.targets, CHUNK)
    ]
    units += [
        LearnerUnit(
            scene=scene,
            method="sac",
            observation="goal",
            seed=seed,
            episodes=10 if quick else 100,
            trials=50 if quick else 200,
            random_episodes=2 if quick else 10,
            hindsight=8,
            reward="log",
            settings=(("alpha", 0.05), ("learning_rate", 1e-3), ("updates", 1)),
        )
        for seed in seeds
    ]
    series = collect(units, context.results(units, "hard task"))
    return [
        Section(
            "The hard task: 1 cm, everywhere",
            [
                Text(
                    f"Targets anywhere that the tip reaches with at least {SPEED:g} m/s: {region.size:.2f} m^2 in "
                    f"cells of {100 * region.cell:g} cm, found with {QUICK_STRIKES if quick else STRIKES:,} random "
                    f"strikes. Hit radius {100 * HIT_RADIUS:g} cm. 'From a library': the search first strikes what "
                    f"passed nearest to the target among {library:,} random strikes (training trials in the table), "
                    "then searches a tenth of the box around it; 'library' strikes what passed near, nearest first, "
                    "and nothing else. SAC "
                    "is trained with hindsight on a reward that falls with the logarithm of the miss distance."
                ),
                Picture(map_of(region, base), "Where the tip is fast. Cross: shoulder.", vector=False),
                Table(main_table(series), caption=f"Trials to the first hit of {counted(scene.targets, 'target')}"),
            ],
        )
    ]


def map_of(region: Region, scene: TargetScene) -> Figure:
    """The region in the strike plane."""
    import matplotlib

    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(6, 6))
        ax = figure.subplots()
        lower, upper = region.box
        shape = np.round((upper - lower) / region.cell).astype(int)
        grid = np.full(shape, np.nan)
        grid[tuple(np.round((region.corners - lower) / region.cell).astype(int).T)] = 1
        ax.imshow(
            grid.T,
            origin="lower",
            extent=(lower[0], upper[0], lower[1], upper[1]),
            cmap=matplotlib.colors.ListedColormap([COLORS["sky"]]),
            interpolation="nearest",
        )
        ax.plot(0, 0, "+", color=COLORS["black"], markersize=12)
        reach = scene.model.reach
        ax.add_patch(Circle((0, 0), reach, fill=False, color="0.5", linestyle="--"))
        ax.set(xlabel="x [m]", ylabel="y [m]", aspect="equal", xlim=(-1.1 * reach, 1.1 * reach))
        ax.set_ylim(-1.1 * reach, 1.1 * reach)
        ax.set_title(f"at least {SPEED:g} m/s: {region.size:.2f} m²; dashed: reach {reach:.2f} m", fontsize=11)
    return figure
