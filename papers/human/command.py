"""People's whip throws compared with planned strikes: `python -m whiptool.human FOLDER --out RUN`."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar

import tyro

from whiptool.commands import cli, run_folders
from whiptool.commands.options.option_group import Count, Ranges, ResumableOptions
from whiptool.errors import NOTHING, InputError
from whiptool.whole_files import write_whole

REPORT = "report.html"
QUICK: dict[str, Any] = {"resamples": 4, "seeds": 1, "trials": 60, "whips": 0, "draws": 100}


@dataclass(frozen=True, kw_only=True)
class HumanOptions(ResumableOptions):
    """People's whip throws compared with planned strikes, as one HTML file."""

    changeable: ClassVar[tuple[str, ...]] = ("workers",)
    ranges: ClassVar[Ranges] = {
        "resamples": Count(0, 10_000),
        "seeds": Count(high=10_000),
        "trials": Count(20, 1_000_000),
        "whips": Count(0, 10_000),
        "draws": Count(10, 1_000_000),
        "workers": Count(high=64),
    }

    folder: tyro.conf.Positional[Annotated[Path | None, tyro.conf.arg(metavar="FOLDER")]] = None
    """Folder with trial_stats.csv and whip_task_data.mat of Krotov et al. 2022, or with both as they were published,
    WhipTask_TrialStats.csv and WhipTaskData.mat."""
    resamples: int = 40
    """Number of bootstrap samples of people for the confidence intervals of the whip's parameters; 0: no intervals."""
    seeds: int = 4
    """Number of random seeds of each method."""
    trials: int = 600
    """Largest number of trials of each search."""
    whips: int = 8
    """Number of unknown whips that adaptation learns; 0: none."""
    draws: int = 200
    """Number of noisy strikes for each noise level."""
    workers: int = 1
    """Number of processes on this machine."""
    quick: bool = False
    """Run a version of a minute, with smaller numbers for the options that are not given."""

    def needs(self) -> tuple[str, ...]:
        return ("h5py", "statsmodels", "torch")


_EXAMPLE = (
    "Compare people's whip throws (Krotov et al. 2022) with planned strikes. "
    "Example: python -m whiptool.human whip_humans --quick"
)


def run(args: Sequence[str] | None) -> int:
    """Do what the command line says, and return the exit status."""
    options = cli.parse_resumable(HumanOptions, command="human", description=_EXAMPLE, args=args, quick=QUICK)
    if options.folder is None:
        raise InputError("FOLDER", NOTHING, "the folder with the data of Krotov et al. 2022", "--help tells more")
    from papers.human.reading import read_people

    with cli.options_named(options):
        run_folders.check_out(options)
        people = read_people(options.folder)
        return _tell(options, people)


def _tell(options: HumanOptions, people: Any) -> int:
    """Work on what is not done yet, write everything, tell people or programs."""
    from papers.human.machine_sections import Effort
    from papers.human.report import SUBTITLE, TITLE, report
    from whiptool.comparison.units import Store
    from whiptool.runs import code_version
    from whiptool.viz.report import to_html, without_verdicts

    effort = Effort(options.seeds, options.trials, options.whips, options.draws)
    with run_folders.open_folder(options, "human", run_folders.configuration(options, "human")) as folder:
        result, sections = report(people, options.resamples, effort, Store(folder.path, workers=options.workers))
        if options.quick:
            sections = without_verdicts(sections, "the quick form is too short to judge by")
        result = _finite({**result, "report": str(folder.path / REPORT), "version": code_version()})
        folder.write_result(result)
        facts = {"throws": str(len(people.throws)), "version": code_version()}
        write_whole(folder.path / REPORT, to_html(TITLE, SUBTITLE, facts, sections))
    if options.json:
        print(json.dumps(result, allow_nan=False))
    else:
        print("\n".join([*_lines(result), f"run folder {folder.path} ({REPORT})"]))
    return 0


def _finite(value: Any) -> Any:
    """Return plain data with None in place of numbers that are not finite, such as the interval of a constant."""
    if isinstance(value, dict):
        return {name: _finite(one) for name, one in value.items()}
    if isinstance(value, list):
        return [_finite(one) for one in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _lines(result: dict[str, Any]) -> list[str]:
    """Return what is said of a run to people."""
    lines = []
    for style in ("discrete", "rhythmic"):
        of = result[style]
        same = all(result["agrees"][style].values())
        lines.append(
            f"{style:9s} {of['throws']} throws: miss {of['min_distance_median']:.3f} m, "
            f"hits {100 * of['hit_share']:.1f} %, hand {of['peak_hand_speed_median']:.1f} m/s, "
            f"tip {of['peak_tip_speed_median']:.1f} m/s, "
            f"{of['duration_mean']:.3f} s; {'as published' if same else 'NOT as published'}"
        )
        off = result["whip"][style]["tapered"]
        peaks, times = (max(map(abs, off[name])) for name in ("peaks_off", "times_off"))
        how = "fitted" if style == "discrete" else "predicted"
        lines.append(f"          whip {how}: peaks within {100 * peaks:.1f} %, times within {times:.3f}")
    for row in result["tolerance"]:
        low, high = row["equivalent_noise_discrete_interval"]
        lines.append(
            f"{row['method']:9s} hits as rarely as people at noise {row['equivalent_noise_discrete']:.3f} "
            f"({low:.3f} to {high:.3f}) [rad, s]"
        )
    for one in result["learning"]:
        lines.append(f"{one['label']}: {one['median'][0]:.3f} m at first, {one['median'][-1]:.3f} m in the end")
    return lines
