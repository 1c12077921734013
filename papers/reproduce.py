"""The paper's figures and tables as one report: `python -m whiptool.reproduce fig6`."""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields, replace
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

import tyro
from tyro.conf import arg

from whiptool.commands import cli
from whiptool.commands.compare import QUICK, ComparisonOptions, open_folder
from whiptool.commands.options.option_group import MANY_TARGETS, Count, Ranges
from whiptool.commands.options.search_options import Methods, Observation, spell_methods
from whiptool.errors import InputError
from whiptool.goals.zone import usual_disc
from whiptool.progress import note
from whiptool.whole_files import write_whole
from whiptool.words import counted

if TYPE_CHECKING:
    from whiptool.comparison import Comparison
    from whiptool.runs import RunFolder

REPORT = "report.html"
Part = Literal[
    "fig5", "fig6", "fig7", "table4", "hard", "sim2real", "adapt", "nah2023", "aim", "spaces", "crack", "all"
]
Row = Literal["nominal", "unseen", "still", "wiggle", "rig"]
# parts with their own model, and their home
OTHERS = {"adapt": "unknown", "nah2023": "nah2023", "aim": "aim", "spaces": "aim.spaces", "crack": "crack"}
_RIG = ("dynamixel_sdk", "cv2")  # servos, and a camera's images
_LEARNED = ("fig6", "fig7", "table4", "hard", "aim", "spaces")  # parts with learners
_OF_PARTS = {**dict.fromkeys(_LEARNED, ("torch",)), "sim2real": _RIG}  # modules of extras
_OF_ANY_PAPER = {"what", "workers", "cluster", "quick", "out", "resume", "json"}  # options
_OF_ADAPT = ("whips", "whip_targets", "rows", "space")


@dataclass(frozen=True, kw_only=True)
class ReproduceOptions(ComparisonOptions):
    """The paper's figures and tables compared with ours, in one HTML file."""

    first: ClassVar[tuple[str, ...]] = ("what", "space", "quick")
    may_be_empty: ClassVar[tuple[str, ...]] = ("further_zones",)
    ranges: ClassVar[Ranges] = dict.fromkeys(("whips", "whip_targets"), Count(high=MANY_TARGETS))

    what: tyro.conf.Positional[Part] = "all"
    """Part to reproduce: figures or a table of Wang et al. 2024, or hard, adapt, nah2023, aim, spaces, crack
    (--help-all describes these). table4 includes Fig. 8; hard uses a hit radius of 1 cm everywhere; sim2real is Figs. 9
    and 10.
    Five parts are not included in all: adapt (unknown whips; an hour or two), nah2023 (another paper, an arm in space;
    minutes), aim (a UR5e strikes points at arrival angles; an hour or two), spaces (joint space compared with hand
    space; an hour) and crack (a loop runs along a whip, with a film; minutes)."""
    whips: int = 30
    """Number of unknown whips of each family, in the part adapt."""
    whip_targets: int = 3
    """Number of targets for each unknown whip, in the part adapt."""
    space: bool = False
    """Run the part adapt in space: a UR5e with ropes, targets with a direction."""
    rows: tuple[Row, ...] = ("still", "wiggle")
    """Measurement before the first strike, in the part adapt. still: the whip is filmed as it hangs; wiggle: it is
    filmed in one slow movement; unseen: none; rig: as still, through emulated servos and images; nominal: nothing is
    learned."""
    further_episodes: int | None = 100
    """Training episodes for observations other than tip, which learn much faster."""
    further_zones: Annotated[tuple[str, ...], arg(metavar="[RADIUS|fast ...]")] = ("0.3", "fast")
    """Repeat Fig. 6 with harder zones: discs of these radii [m] around --target, and fast, where the tip of random
    strikes moves at 3 m/s or more."""
    further_methods: Methods = ("directl", "ga", "sac", "td3", "ddpg", "ppo")
    """Methods that are compared in the zones of --further-zones; random is always added."""
    further_observation: tuple[Observation, ...] = ("goal",)
    """Observations of the learners in the zones of --further-zones."""

    def __post_init__(self) -> None:
        spell_methods(self, "further_methods")

    def check(self) -> None:
        from whiptool.comparison.target_scene import check_zone
        from whiptool.optimizers import find_method

        super().check()
        for method in self.further_methods:
            find_method(method)
        model = self.build_model()
        target = self.build_target()
        target.check_fits(model)
        reach = model.reach
        for zone in self.further_zones:
            try:
                check_zone(zone, target.position, reach)
            except InputError as error:
                raise error.renamed("--further-zones") from None
        if self.what in OTHERS:
            idle = {f.name for f in fields(self)} - _OF_ANY_PAPER - set(_OF_ADAPT)
            self.refuse_given(f"only without {self.what}, which has its own", *sorted(idle))
        if self.what != "adapt":
            self.refuse_given("only with the part adapt", *_OF_ADAPT)
        if self.space and "rig" in self.rows:
            raise InputError("--rows", "rig", "only without --space: the servos are those of a planar arm")
        further = ("further_zones", "further_methods", "further_observation")
        if self.what not in ("fig6", "all"):
            self.refuse_given("only with the part fig6 or all", *further)
        elif not self.further_zones:
            self.refuse_given("only with --further-zones", *further[1:])

    def needs(self) -> tuple[str, ...]:
        parts = set(_OF_PARTS) - set(OTHERS) if self.what == "all" else {self.what}
        needed = [module for part, modules in _OF_PARTS.items() if part in parts for module in modules]
        if self.what == "adapt" and "rig" in self.rows:
            needed += _RIG
        return (*super().needs(), *needed)


_EXAMPLE = (
    "Reproduce figures and tables of Wang et al. 2024 in one HTML file, with the published numbers. "
    "`all` takes hours and can be resumed. Example: python -m whiptool.reproduce all --quick"
)


def run(args: Sequence[str] | None) -> int:
    """Do what the command line says, and return the exit status."""
    options = cli.parse_resumable(ReproduceOptions, command="reproduce", description=_EXAMPLE, args=args, quick=QUICK)
    from whiptool.comparison.plan import PAPER_METHODS
    from whiptool.rl.task import OBSERVATIONS

    with cli.options_named(options):
        if options.what in OTHERS:
            comparison = further = _other(options)
        else:
            comparison = options.comparison(PAPER_METHODS, OBSERVATIONS)
            further = options.comparison(options.further_methods, options.further_observation)
        with open_folder("reproduce", options, comparison) as folder:
            return _reproduce(options, comparison, further, folder)


def _reproduce(options: ReproduceOptions, comparison: Comparison, further: Comparison, folder: RunFolder) -> int:
    """Work on what is not done yet, write the report, tell people or programs."""
    from papers.context import Context
    from papers.parts import ALL, PARTS
    from whiptool.comparison import Store
    from whiptool.viz.report import to_html, without_verdicts

    scene = comparison.scene
    if options.what not in OTHERS:
        target = options.build_target(scene.model).position
        options.warn_if_coarse(scene.model, scene.controller, target, scene.t_stay)
    store = Store(folder.path, workers=options.processes(), cluster=options.cluster)
    context = Context(
        comparison,
        store,
        options.quick,
        whips=options.whips,
        whip_targets=options.whip_targets,
        space=options.space,
        rows=tuple(options.rows),
        further=further,
        zones=tuple(options.further_zones),
    )
    sections, start = [], time.monotonic()
    for name in ALL if options.what == "all" else [options.what]:
        note(f"whiptool: {name}")
        found = PARTS[name](context)
        sections += without_verdicts(found, _NO_VERDICT) if options.quick else found
        title, subtitle, facts = _head(options, comparison)
        text = to_html(title, subtitle + (_QUICK if options.quick else ""), facts, sections)
        write_whole(folder.path / REPORT, text)  # after each part: a killed run has shown something
    claims = [asdict(claim) for section in sections for claim in section.claims]
    summary = {
        "what": options.what,
        "report": str(folder.path / REPORT),
        "claims": claims,
        "worker_deaths": store.deaths,
        "wall_time": time.monotonic() - start,
    }
    folder.write_result(summary)
    if options.json:
        print(json.dumps(summary, allow_nan=False))
    else:
        print("\n".join(f"{claim['verdict']}: {claim['claim']}\n    {claim['ours']}" for claim in claims))
        if options.quick:
            print(_QUICK.strip())
        print(f"report {folder.path / REPORT}")
    return 0


def _other(options: ReproduceOptions) -> Comparison:
    """A comparison that only tells the run folder what model and controller are: no learner is trained."""
    part = _part(options.what)
    comparison = options.comparison(("directl",), ())
    of_part = {"model": part.MODEL, "controller": part.CONTROLLER, "zone": usual_disc(part.MODEL)}
    return replace(comparison, scene=replace(comparison.scene, **of_part))


def _part(what: str) -> ModuleType:
    """Return the package of a part with its own model."""
    return import_module(f"papers.{OTHERS[what]}")


def _head(options: ReproduceOptions, comparison: Comparison) -> tuple[str, str, dict[str, str]]:
    """Title, subtitle and facts of the report."""
    if options.what in OTHERS:
        part = _part(options.what)
        return part.TITLE, part.SUBTITLE, part.facts()
    return "A whip, a target, and six ways to learn", _SUBTITLE, _facts(options, comparison)


_SUBTITLE = (
    "The LEMON framework (Wang, Xiong, Tolu and Gorb 2024, doi:10.1007/s42235-024-00534-2), its claims and what was "
    "measured here. Verdicts are computed from the data."
)
_NO_VERDICT = "the quick form is far too short to judge by"
_QUICK = " Quick form: it shows that all works; it is far too short to judge the paper by."


def _facts(options: ReproduceOptions, comparison: Comparison) -> dict[str, str]:
    """What was run, for the report's head."""
    from whiptool import default_bounds
    from whiptool.models.strike import strike_names
    from whiptool.runs import code_version

    scene, further = comparison.scene, comparison.further_episodes
    middle = options.build_target(scene.model).position
    bounds = default_bounds(scene.model.arm)
    limits = ", ".join(
        f"{name} {low:.3f} to {high:.3f} {'s' if name == 'D' else 'rad'}"
        for name, low, high in zip(strike_names(scene.model.arm), bounds.lower, bounds.upper, strict=True)
    )
    return {
        "code": f"whiptool {code_version()}",
        "model": f"{scene.model.name}: {scene.model.whip.N} nodes, {options.controller_label()}",
        "bounds of a strike": f"{limits} (the paper prints none)",
        "watched after the movement": f"{scene.t_stay:g} s (not printed in the paper)",
        "targets": f"{scene.targets} in a circle of {options.zone_radius:g} m around {middle} m, seed "
        f"{options.target_seed}; at most {scene.cap} trials each; hit radii "
        + ", ".join(f"{radius:g}" for radius in scene.radii)
        + " m",
        "training": f"{counted(comparison.plan.episodes, 'episode')} of {counted(comparison.plan.trials, 'strike')}, "
        f"{comparison.plan.random_episodes} random; {counted(comparison.seeds, 'seed')}"
        + (f"; observations other than tip {counted(further, 'episode')}" if further is not None else ""),
    }
