"""`python -m whiptool.identify SWINGS... --drive free`: a pendulum of any number of links, fitted to its angles."""

from __future__ import annotations

import json
import sys
from typing import TYPE_CHECKING, Any

from whiptool.commands import cli
from whiptool.commands.fit_status import convergence_status
from whiptool.commands.options.identify_options import IDENTIFIED, REPORT, IdentifyOptions
from whiptool.errors import InputError
from whiptool.identification.pendulum import AngleRecording, Pendulum
from whiptool.progress import note
from whiptool.whole_files import write_whole
from whiptool.words import counted

if TYPE_CHECKING:
    from whiptool.identification.results import Fit


def identify_pendulum(options: IdentifyOptions) -> int:
    """Read, fit, write the run folder, and tell people or programs; the exit status.

    Raises:
        InputError: An option, file or recording breaks its rule; nothing has been written then.
    """
    from whiptool.identification.fit import fit
    from whiptool.identification.inputs import split
    from whiptool.identification.pendulum_files import read_angles, read_pendulum
    from whiptool.identification.problem import HUBER, FitOptions

    if not options.model.endswith(".toml"):
        raise InputError("--model", options.model, "a pendulum's .toml file, with --drive free", "see the file formats")
    guess = read_pendulum(options.model)
    swings = {swing.source: swing for path in options.recordings for swing in read_angles(path)}
    fitted, held_out = split(tuple(swings), options.held_out)
    for name in held_out:
        if name not in swings:
            raise InputError("--held-out", name, "one of the swings " + ", ".join(swings))
    for swing in swings.values():
        if swing.angles.shape[1] != guess.n:
            raise InputError(f"{swing.source}: angles", f"{swing.angles.shape[1]} links", f"{guess.n}, as --model has")
    free = full_names(options.free, guess)
    how = FitOptions(
        drive="free",
        loss=HUBER if options.loss == "huber" else None,
        starts=options.starts,
        seed=options.seed,
        pieces=options.pieces,
    )
    train, unseen = ([swings[name] for name in names] for names in (fitted, held_out))
    with _folder(options, free, fitted, held_out) as folder:
        parameters = (
            f"{counted(len(free), 'parameter')} to {counted(len(train), 'swing')}, {counted(options.starts, 'start')}"
        )
        note(f"whiptool: fitting {parameters}")
        found = fit(train, guess, free, held_out=unseen, options=how)
        return _report(options, found, train, unseen, folder)


def full_names(names: tuple[str, ...], pendulum: Pendulum) -> tuple[str, ...]:
    """Return the names of --free in full: `link.com[0]`, `link.com[1]` of `com`, `link.com[1]` of `com[1]`.

    Raises:
        InputError: The pendulum knows none such.
    """
    from whiptool.identification.inputs import names_of

    known = pendulum.values()
    found: list[str] = []
    for name in names:
        chosen = names_of(name, known)
        if not chosen:
            raise InputError("--free", name, "one of " + ", ".join(known))
        found += [x for x in chosen if x not in found]
    if not found:
        raise InputError("--free", "none", "one or more names", "such as com inertia")
    return tuple(found)


def _folder(options: IdentifyOptions, free: tuple[str, ...], fitted: list[str], held_out: list[str]) -> Any:
    recordings = [{"source": x, "held_out": x in held_out} for x in (*fitted, *held_out)]
    config = cli.configuration(options, "identify", free=list(free), recordings=recordings)
    return cli.open_folder(options, "identify", config)


def _report(
    options: IdentifyOptions, found: Fit, train: list[AngleRecording], unseen: list[AngleRecording], folder: Any
) -> int:
    from whiptool.identification.pendulum_files import write_pendulum
    from whiptool.identification.pendulum_report import sections
    from whiptool.identification.summary import bound_lines, fit_table, misfit_line, parameter_lines, warning
    from whiptool.viz.report import to_html

    assert isinstance(found.plant, Pendulum)
    summary = fit_table(found, train, unseen)
    summary |= {"model": options.model, "seed": options.seed}
    summary |= {"identified": str(folder.path / IDENTIFIED), "report": str(folder.path / REPORT)}
    write_pendulum(found.plant, folder.path / IDENTIFIED)
    folder.write_result(summary)
    facts = {"started from": options.model, "swings": f"{len(train)} fitted, {len(unseen)} held out"}
    subtitle = f"{found.status.value.capitalize()}." + (f" Warning: {said}." if (said := warning(found)) else "")
    page = to_html("Identified pendulum", subtitle, facts, sections(found, train, unseen))
    write_whole(folder.path / REPORT, page)
    if found.failed:
        number, starts = len(found.failed), len(found.runs)
        print(
            f"whiptool: {number} of {counted(starts, 'start')} failed: they ended far above the best", file=sys.stderr
        )
    if said is not None:
        print(f"whiptool: {said}", file=sys.stderr)
    held = summary["held_out_rmse"]
    unseen_error = "none held out" if held is None else f"{1e3 * held:.3g} mrad held out"
    lines = [
        f"{found.status.value}; {summary['fit_time']:.1f} s; 95 % intervals",
        *parameter_lines(found),
        f"  error RMS   {1e3 * summary['rmse']:.3g} mrad fitted, {unseen_error}",
        f"  misfit      {misfit_line(found)}",
        *(f"  at bound    {line}" for line in bound_lines(found)),
        f"  run folder  {folder.path} ({REPORT}, {IDENTIFIED})",
    ]
    print(json.dumps(summary, allow_nan=False) if options.json else "\n".join(lines))
    return convergence_status(found)
