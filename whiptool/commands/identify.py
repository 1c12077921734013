"""Fit a whip's parameters to recorded strikes: `python -m whiptool.identify STRIKES... --free k b m`."""

from __future__ import annotations

import dataclasses
import re
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from whiptool.commands import cli, run_folders
from whiptool.commands.options.identify_options import IDENTIFIED, RECORDINGS, REPORT, IdentifyOptions
from whiptool.errors import InputError
from whiptool.progress import note
from whiptool.runs import CITATIONS
from whiptool.whole_files import write_whole
from whiptool.words import counted

if TYPE_CHECKING:
    from whiptool.identification.plant import Plant
    from whiptool.identification.results import Fit
    from whiptool.impedance import Controller
    from whiptool.models import WhipProfile
    from whiptool.recording.readers import VideoSource
    from whiptool.recording.strike_recording import StrikeRecording
    from whiptool.runs import RunFolder

_LIKE = {6: "such as --model ur5e", 7: "such as --model fr3 or --model panda"}  # by an arm's number of joints
_EXAMPLE = (
    "Fit a whip's parameters to recorded strikes. "
    "Example: python -m whiptool.identify strike1.csv strike2.csv strike3.csv --free k b m --out fitted"
)


OF_PROFILE = ("bending_stiffness", "bending_damping", "linear_density")  # --free by default, of a whip's profile


def full_names(names: tuple[str, ...], plant: Plant) -> tuple[str, ...]:
    """Return the full names of the parameters that --free names; for an arm without a whip, a short name such as `com`
    stands for that of every link.

    Raises:
        InputError: The plant has no such parameter, or several; the message names an option that helps, if there is
            one.
    """
    from whiptool.dynamics.structure import LUMPED
    from whiptool.identification.inputs import full_name
    from whiptool.identification.plant import BareArm
    from whiptool.identification.variables import names_of

    found, known = [], plant.values()
    for name in names:
        if isinstance(plant.model, BareArm) and (each := names_of(name, known)):
            found += [x for x in each if x not in found]
            continue
        try:
            found.append(full_name(name, plant))
        except InputError as error:
            fix = error.fix
            if fix and plant.profile is None and name.removeprefix("whip.") in LUMPED:  # there is one per node
                fix = f"{fix}; or fit a --profile"
            raise InputError("--free", name, error.allowed, fix) from None
    return tuple(found)


class FitRun:
    """One run of `identify`: its options and recordings are checked before a file is written."""

    def __init__(self, options: IdentifyOptions) -> None:
        from whiptool.identification.inputs import each_episode, read_prior, split
        from whiptool.identification.plant import Plant
        from whiptool.identification.problem import HUBER, FitOptions
        from whiptool.runs import code_version

        self.options = options
        self.model = options.build_model()
        self.bare = options.drive == "free"  # an arm without a whip
        fallback = None if self.bare else options.build_controller()
        names, held_out = split(each_episode(options.recordings), options.held_out)
        profile = self._profile() if options.profile else None
        if not options.free:
            raise InputError("--free", "none", "one or more names of parameters to fit", "such as --free k b")
        # a slip is found before hours of film are tracked
        full_names(options.free, Plant(self.model, fallback, profile, options.clamp))
        controller = self._gather(names, held_out)
        self.assumed = controller is None and options.drive == "command"
        if controller is not None:
            held = "only for recordings without their controller"
            options.refuse_given(held, "controller", "preset")
        self.plant = Plant(self.model, None if self.bare else controller or fallback, profile, options.clamp)
        self.free = full_names(options.free, self.plant)
        self.how = FitOptions(
            drive=options.drive,
            per_recording=options.per_recording,
            prior=read_prior(options.prior, self.plant, self.free),
            loss=HUBER if options.loss == "huber" else None,
            starts=options.starts,
            seed=options.seed,
            knots=options.knots,
            pieces=options.pieces,
            progress=True,
        )
        self._check_fit()
        self.version = code_version()

    def _profile(self) -> WhipProfile:
        from whiptool.identification.inputs import profile_of

        try:
            return profile_of(self.model, self.options.model)
        except InputError as error:
            raise error.within("--profile: ") from None

    def _labelled(self, name: str, recording: StrikeRecording) -> StrikeRecording:
        """Return a recording whose labels stay with their markers."""
        from whiptool.recording.labels import check_labels, put_back

        labels = check_labels(recording)
        if labels.kept:
            return recording
        if self.options.mend_labels:
            print(f"{name}: put back: {labels}", file=sys.stderr)
            return put_back(recording, labels)
        rule = "labels that stay with their markers"
        raise InputError("recording", f"{name}: {labels}", rule, "correct them at their source, or use --mend-labels")

    def _gather(self, names: list[str], held_out: list[str]) -> Controller | None:
        """Read or track all recordings, and find their plane; the controller that they hold."""
        from whiptool.identification.inputs import common_controller, may_be_filmed, opened, read_marker, tracked
        from whiptool.recording.strike_plane import check_one_plane, fit_plane

        tip = read_marker(self.options.tip)
        if tip is not None and not any(may_be_filmed(name) for name in (*names, *held_out)):
            raise InputError("--tip", self.options.tip, "only with films, in which the tip is tracked")
        cameras, handle = self._cameras([*names, *held_out]), self.options.drive == "handle"
        every = {name: opened(name, handle=handle, cameras=cameras) for name in (*names, *held_out)}
        self._check_films(every)  # before hours of film are tracked
        found = [tracked(x, name=name, tip=tip) for name, x in every.items()]
        recordings = [r for r, _ in found]
        recordings = [_named_apart(r, name, recordings) for name, r in zip(every, recordings, strict=True)]
        self._check_joints(recordings)
        if not self.bare:
            pairs = zip(every, recordings, strict=True)
            recordings = [self._labelled(name, r.for_model(self.model)) for name, r in pairs]
        self.files = list(every)
        self.synthetic = any(synthetic or "(virtual)" in recording.camera for recording, synthetic in found)
        _check_cameras(recordings)
        self.plane = fit_plane(recordings) if self.model.dimension == 2 else None
        if self.plane is not None:
            check_one_plane(recordings, self.plane)
            recordings = [self.plane.project(recording) for recording in recordings]
        self.recordings, self.held_out = recordings[: len(names)], recordings[len(names) :]
        return common_controller(recordings)

    def _check_joints(self, recordings: Sequence[StrikeRecording]) -> None:
        """Refuse strikes of an arm with another number of joints than the model's."""
        for recording in () if self.bare else recordings:
            n = None if recording.strike is None else len(recording.strike.q_i)
            if n is not None and n != self.model.arm.n:
                rule = f"a model of the arm that made the strike of {recording.called}, which has {n} joints"
                raise InputError("--model", f"{self.options.model}, {self.model.arm.n} joints", rule, _LIKE.get(n, ""))

    def _check_films(self, recordings: Mapping[str, StrikeRecording | VideoSource]) -> None:
        """Refuse films that do not show what the model moves in: a plane, or space."""
        from whiptool.recording.strike_recording import StrikeRecording

        for name, film in recordings.items():
            if isinstance(film, StrikeRecording):
                continue
            if self.bare:
                raise InputError("recording", name, "angles of links, with --drive free")
            if self.model.dimension == 3 and film.view is None:
                fix = 'state camera = "NAME" in its sidecar, and cameras = "FILE" or --cameras FILE'
                raise InputError("recording", name, "a film of a camera in space, for a model in space", fix)
            if self.model.dimension == 2 and film.view is not None:
                rule = "a film whose strike plane is calibrated, for a model in the plane"
                raise InputError("recording", name, rule, "a camera in space is for a --model in space")

    def _cameras(self, names: list[str]) -> Path | None:
        """The file of the cameras, if it was given and a recording is in pixels or a film."""
        from whiptool.identification.inputs import in_pixels, may_be_filmed

        if self.options.cameras is None:
            return None
        if not any(in_pixels(name) or may_be_filmed(name) for name in names):
            nothing = "only with films or recordings in pixels (tip_u, tip_v; or body parts of a named camera)"
            raise InputError("--cameras", self.options.cameras, nothing)
        return Path(self.options.cameras)

    def _check_fit(self) -> None:
        """Refuse what the fit would refuse, before it begins."""
        from whiptool.identification.beginnings import check_beginnings
        from whiptool.identification.predict import Predictor
        from whiptool.identification.readings import NEUTRAL
        from whiptool.identification.variables import variables_of

        nodes = self.options.nodes
        if nodes and not self.held_out:
            raise InputError(
                "--nodes",
                nodes,
                "only with a held-out recording, whose error decides among the numbers",
                "give --held-out 1",
            )
        if nodes and self.how.prior is not None and any(n.startswith("whip.") for n in self.how.prior.names):
            raise InputError("--prior", self.how.prior.names, "no values per node with --nodes", "give --profile")
        self.plants = {N: self.plant.with_nodes(N) for N in nodes}
        self.plants = self.plants or {0 if self.bare else self.model.whip.N: self.plant}
        for plant in self.plants.values():
            variables_of({**plant.values(), **NEUTRAL}, self.free, {}, {})  # starts of all are in order
        self._check_whip_seen()
        own = self.options.per_recording
        every, drive, knots = [*self.recordings, *self.held_out], self.options.drive, self.options.knots
        try:
            predictor = Predictor(every, self.plant, drive=drive, shared=self.free, own=own, knots=knots)
            remarks = check_beginnings(predictor, self.plant)
        except InputError as error:
            raise self._by_file(error, every) from None
        self.remarks = remarks
        for remark in remarks:
            self._say(remark)

    def _check_whip_seen(self) -> None:
        """Refuse to fit a whip's parameters to recordings of joints alone."""
        from whiptool.identification.drives import unknown_markers

        if self.bare or not all(name.startswith(("whip.", "profile.")) for name in self.free):
            return
        for name, recording in zip(self.files, [*self.recordings, *self.held_out], strict=True):
            if recording.joints_alone:
                raise unknown_markers(recording).within(f"{name}: ")

    def _by_file(self, error: InputError, recordings: Sequence[StrikeRecording]) -> InputError:
        """The error with the file that was given, where it names the source of a recording in it."""
        for name, recording in zip(self.files, recordings, strict=True):
            if recording.source and recording.source in str(error) and name not in str(error):
                return error.within(f"{name}: ")
        return error

    def open_folder(self) -> RunFolder:
        """Return the run folder, with its configuration."""
        pairs = [(r, False) for r in self.recordings] + [(r, True) for r in self.held_out]
        files = _file_names([r.source for r, _ in pairs])
        recordings = [
            {"source": r.source, "sha256": r.sha256, "held_out": out, "file": f"{RECORDINGS}/{file}"}
            for (r, out), file in zip(pairs, files, strict=True)
        ]
        config = run_folders.configuration(
            self.options,
            "identify",
            None if self.bare else self.plant.model,  # an arm without a whip is in the file of --model
            self.plant.controller,
            free=list(self.free),
            recordings=recordings,
        )
        return run_folders.open_folder(self.options, "identify", config)

    def write_recordings(self, folder: RunFolder) -> None:
        """Write all recordings, with the held-out ones, to the run folder, and print their readers' remarks."""
        recordings = [*self.recordings, *self.held_out]
        said: dict[tuple[str, ...], list[str]] = {}
        for name, recording in zip(self.files, recordings, strict=True):
            said.setdefault(recording.remarks, []).append(name)
        for remarks, names in said.items():
            others = f" and {counted(len(names) - 1, 'other')}" if len(names) > 1 else ""
            if remarks:
                self._say(f"{names[0]}{others}: {'; '.join(remarks)}")
        (folder.path / RECORDINGS).mkdir(exist_ok=True)
        for recording, file in zip(recordings, _file_names([r.source for r in recordings]), strict=True):
            recording.save(folder.path / RECORDINGS / file)

    def fit(self) -> None:
        """Fit the parameters for every number of nodes that is to be tried."""
        from whiptool.identification.fit import best_nodes, fit
        from whiptool.identification.results import root_mean_square
        from whiptool.identification.summary import coverage_words, error_words

        self.tried: list[tuple[int, float, float]] = []
        fits: dict[int, Fit] = {}
        for N, plant in self.plants.items():
            self._say(
                f"fitting {counted(len(self.free), 'parameter')} to {counted(len(self.recordings), 'recording')}, "
                f"{'' if self.bare else f'N = {N}, '}{counted(self.how.starts, 'start')}"
            )
            fits[N] = fit(self.recordings, plant, self.free, held_out=self.held_out, options=self.how)
            inside, outside = (root_mean_square(x) for x in (fits[N].recordings, fits[N].held_out))
            assert inside is not None
            outer = fits[N].held_out
            held_out = f", held out {error_words(outer)} ({coverage_words(outer)})" if outer else ""
            self._say(f"{fits[N].status.value}; RMS {error_words(fits[N].recordings)}{held_out}")
            if self.options.nodes:
                assert outside is not None
                self.tried.append((N, inside, outside))
        self.N = best_nodes(fits) if self.tried else next(iter(fits))
        self.found = fits[self.N]
        for remark in self.found.remarks:
            if remark not in self.remarks:
                self._say(remark)

    @property
    def warning(self) -> str | None:
        """Warning, with a remedy, if the model does not explain the recordings; None if it does."""
        from whiptool.identification.summary import warning
        from whiptool.identification.time_base import CLOCK

        said, fault = warning(self.found), self.found.clock_fault
        if said is None:
            return None
        if self.found.smoothed:
            return f"{said}; export them as they were taken, or fit the filters with --per-recording smoothing"
        if fault is not None:
            return f"{said}; --per-recording {fault.kind} fits it" if fault.kind in CLOCK else said
        joints = all(recording.joints_q is not None for recording in self.recordings)
        cure = "try --drive joints, which needs no model of arm and friction" if joints else "check the recordings"
        return f"{said}; free what is missing, or {cure if self.options.drive == 'command' else 'check the recordings'}"

    def report(self, folder: RunFolder) -> int:
        """Write the fit and print it, then draw the report; return the exit status."""
        from whiptool.identification.plant import write_bare_arm
        from whiptool.identification.summary import lost
        from whiptool.models.files import write_model

        plant, path = self.found.plant, folder.path
        write: Any = write_bare_arm if self.bare else write_model
        write(dataclasses.replace(plant.model, name=f"{self.model.name} identified"), path / IDENTIFIED)
        summary = self._summary(plant, path)
        folder.write_result(summary)
        if not self.found.converged:
            said = f"not converged: {self.found.status.value}: values and intervals may be off"
            self._say(f"{said}; more --starts or a nearer --model may help")
        if self.found.failed:
            number, starts = len(self.found.failed), len(self.found.runs)
            tried = counted(starts, "start")
            self._say(f"{number} of {tried} failed: they ended far above the best, which alone is judged")
        if self.warning is not None:
            self._say(self.warning)
        if useless := lost(self.found):
            self._say(useless)
        self.options.tell(summary, self._text(summary, path))
        note("drawing ...")
        from whiptool.identification.fit_report import sections
        from whiptool.viz.report import to_html

        parts = sections(self.found, self.recordings, self.held_out, nodes=self.tried, chosen=self.N)
        title = f"Identified {'arm' if self.bare else 'whip'}"
        write_whole(path / REPORT, to_html(title, self._subtitle(), self._facts(), parts))
        return 0 if self.found.converged and not useless else 1

    def _say(self, line: str) -> None:
        print(f"whiptool: {line}", file=sys.stderr)

    def _summary(self, plant: Plant, path: Path) -> dict[str, Any]:
        from whiptool.identification.summary import fit_table
        from whiptool.impedance.controller import controller_to_table

        plane = None
        if self.plane is not None:
            plane = {
                "out_of_plane_rms": self.plane.rms,
                "out_of_plane_largest": self.plane.largest,
                "tilt": self.plane.tilt,
                "offset": self.plane.offset,
            }
        return {
            **fit_table(self.found, self.recordings, self.held_out),
            "warning": self.warning,
            "model": self.model.name,
            "N": self.N,
            "nodes": [{"N": n, "rmse": a, "held_out_rmse": b} for n, a, b in self.tried],
            "controller": None if plant.controller is None else controller_to_table(plant.controller),
            "controller_assumed": self.assumed,
            "plane": plane,
            "synthetic": self.synthetic,
            "identified": str(path / IDENTIFIED),
            "report": str(path / REPORT),
            "seed": self.options.seed,
            "version": self.version,
        }

    def _subtitle(self) -> str:
        nodes = "" if self.bare else f" with {self.N} nodes"
        said = f"{', '.join(self.free)} of {self.model.name}{nodes}, fitted to {len(self.recordings)} "
        kind = {"passive": "passive swings", "free": "swings"}.get(self.options.drive, "recorded strikes")
        said += f"{kind}, driven by {_DRIVEN[self.options.drive]}. {self.found.status.value.capitalize()}."
        said += "" if self.warning is None else f" Warning: {self.warning}."
        return said + (" Some of the recordings are synthetic: no real camera took them." if self.synthetic else "")

    def _facts(self) -> dict[str, str]:
        """What was run, for the report's head."""
        from whiptool.identification.summary import recording_facts

        options = self.options
        facts = {
            "code": f"whiptool {self.version}",
            "method": "maximum likelihood" + ("" if self.how.prior is None else " with a prior (a posteriori)")
            + "; Levenberg-Marquardt on the compiled model's exact sensitivities; "
            + ("Huber's loss" if self.how.loss else "least squares")
            + f"; {options.starts} starts, the first as given, the others within a factor of {self.how.dispersion:g}",
            "started from": f"{options.model}",
        }  # fmt: skip
        if options.drive == "command":
            facts["controller"] = f"{options.law_label()}, assumed: no recording says" if self.assumed \
                else "as the recordings hold it"  # fmt: skip
        own = (*options.per_recording, *(("first state",) if options.drive == "passive" else ()))
        if own:
            facts["each recording's own"] = ", ".join(own)
        if options.drive == "passive":
            facts["held"] = "behind a free hinge" if options.clamp is None else "in a clamp"
        if self.plane is not None:
            facts["strike plane"] = str(self.plane)
        return facts | recording_facts([*self.recordings, *self.held_out])

    def _text(self, summary: dict[str, Any], path: Path) -> str:
        from whiptool.identification.results import known_part
        from whiptool.identification.summary import (
            assumed_errors,
            bound_lines,
            error_words,
            freed_line,
            lag_lines,
            misfit_line,
            own_lines,
            parameter_lines,
        )

        lines = [
            f"{self.found.status.value}; {summary['fit_time']:.1f} s; 95 % intervals",
            *parameter_lines(self.found),
        ]
        said = f"{error_words(self.found.held_out)} held out" if self.held_out else "none held out"
        if any(r.predicted_from is not None for r in self.found.held_out):
            said += f" (without the {known_part(self.found.drive)[1]} of each, which gave what is unknown of it)"
        lines.append(f"  error RMS   {error_words(self.found.recordings)} fitted, {said}")
        if self.plane is not None:
            lines.append(f"  out of plane {1e3 * self.plane.rms:.3g} mm RMS")
        lines.append(f"  misfit      {misfit_line(self.found)}")
        lines += [f"  errors      {line}" for line in assumed_errors(self.found, self.recordings)]
        lines += [f"  at bound    {line}" for line in bound_lines(self.found)]
        lines += [f"  base        {line}" for line in [freed_line(self.found)] if line]
        lines += [f"  own         {line}" for line in own_lines(self.found)]
        lines += [f"  lag         {line}" for line in lag_lines(self.found)]
        if self.assumed:
            lines.append(f"  controller  {self.options.law_label()}, assumed: no recording says")
        lines.append(f"  run folder  {path} ({REPORT}, {IDENTIFIED}, {RECORDINGS}, {CITATIONS})")
        return "\n".join(lines)


_DRIVEN = {
    "command": "the command",
    "joints": "the measured joints",
    "robot": "the command, behind a lag of the robot",
    "hand": "the hand's measured pose",
    "handle": "the tracked handle",
    "passive": "nothing",
    "free": "nothing",
}


def _named_apart(recording: StrikeRecording, file: str, others: Sequence[StrikeRecording]) -> StrikeRecording:
    """The recording under the name of its file, where another one has the same source, as parts of one take have."""
    from whiptool.given_files import sha256

    if recording.source == file or sum(r.source == recording.source for r in others) == 1:
        return recording
    notes = (*recording.notes, f"source: {recording.source}") if recording.source else recording.notes
    path = Path(file)
    digest = sha256(path) if path.is_file() else recording.sha256
    return dataclasses.replace(recording, source=file, sha256=digest, notes=notes)


def _check_cameras(recordings: Sequence[StrikeRecording]) -> None:
    """Refuse what cameras saw that do not stand where they were calibrated.

    Raises:
        InputError: Two of them do not agree about where the markers were.
    """
    from whiptool.vision.multi_view import disagreements, moved

    if not (found := disagreements(recordings)):
        return
    name, told = moved(found), "; ".join(dict.fromkeys(map(str, found)))
    either = "one of them was moved, markers or cameras were exchanged, or they saw different strikes"
    which = f"{name} was moved" if name is not None else either
    rule = "cameras that stand as they were calibrated, whose lines of sight to a marker meet"
    raise InputError("cameras", f"lines of sight that do not meet: {told}", rule, f"{which}: calibrate again")


def _file_names(sources: list[str]) -> list[str]:
    """A different NPZ name for each source."""
    names: list[str] = []
    for source in sources:
        stem = re.sub(r"[^\w.-]+", "_", Path(source).stem) or "recording"
        number = 1
        while (name := f"{stem}.npz" if number == 1 else f"{stem}-{number}.npz") in names:
            number += 1
        names.append(name)
    return names


def resolved(options: IdentifyOptions) -> IdentifyOptions:
    """Return the options with the recordings that run folders hold and, unless they are given, the model of their run,
    and parameters that this model has.

    What was chosen is printed.
    """
    from whiptool.identification.inputs import model_of_run, recording_in
    from whiptool.models.files import model_to_table

    held_out = options.held_out and tuple(map(recording_in, options.held_out))
    recordings = tuple(map(recording_in, options.recordings))
    options = dataclasses.replace(options, recordings=recordings, held_out=held_out)
    if options.drive == "free":
        return options
    if not options.given("model"):
        found = [x for x in map(model_of_run, (*options.recordings, *(options.held_out or ()))) if x]
        of_runs = [dataclasses.replace(options, **{k: _as_option(v) for k, v in x.items()}) for x in found]
        tables = [model_to_table(one.find_model()) for one in of_runs]
        if any(table != tables[0] for table in tables):
            raise InputError("--model", "recordings of runs with different models", "one model, given with --model")
        if tables and tables[0] != model_to_table(options.find_model()):
            words = " --mount ".join(map(_words, found[0].values()))
            note(f"whiptool: the model is that of the recording's run: --model {words}")
            options = of_runs[0]
    return _with_parameters(options)


def _as_option(value: Any) -> Any:
    return tuple(value) if isinstance(value, list) else value


def _words(value: Any) -> str:
    return " ".join(value) if isinstance(value, list) else str(value)


def _with_parameters(options: IdentifyOptions) -> IdentifyOptions:
    """Return the options with parameters of the profile by default, if the whip has a value per node or a profile."""
    from whiptool.models.profile import profile_from

    if options.given("free"):
        return options
    whip = options.find_model().whip
    if not options.profile:
        if all(isinstance(x, float | int) for x in (whip.k, whip.b, whip.m)):
            return options
        try:
            profile_from(whip)
        except InputError:
            return options  # a name of a node has to be given, as the error of --free says
    note(
        f"whiptool: --profile --free {' '.join(OF_PROFILE)} by default, "
        "as the model's whip has a value per node or a profile"
    )
    return dataclasses.replace(options, profile=True, free=OF_PROFILE)


def _work(options: IdentifyOptions) -> int:
    run_folders.check_out(options)  # before hours of film are tracked
    run = FitRun(resolved(options))
    with run.open_folder() as folder:
        run.write_recordings(folder)
        run.fit()
        return run.report(folder)


main = cli.command(IdentifyOptions, "identify", _EXAMPLE, _work)  # 1 also where the fit did not converge or is lost
