"""Run folders of commands: stored options and configurations, new folders, and folders of resumed runs."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from whiptool.commands.options.option_group import OptionGroup, OutputOptions, ResumableOptions, renaming
from whiptool.errors import NOTHING, InputError, alike
from whiptool.version import __version__

if TYPE_CHECKING:
    from whiptool.impedance import Controller
    from whiptool.models import Model
    from whiptool.runs import RunFolder

T = TypeVar("T", bound=OptionGroup)


def options_of_run(options: type[T], run_folder: Path, *, command: str) -> T:
    """Return the options that a command left in its run folder.

    Raises:
        InputError: The folder is of another command, or its configuration is damaged.
    """
    from whiptool.runs import config_of

    return stored_options(options, config_of(run_folder, command)["options"], run_folder)


def stored_options(options: type[T], table: dict[str, Any], path: Path) -> T:
    """Return the options that a run folder holds; an optional one that is missing is None, which TOML cannot express.

    Raises:
        InputError: The folder has options of another command.
    """
    from whiptool.given_files import check_kinds, parsing
    from whiptool.runs import CONFIG

    kinds = {f.name: str(f.type) for f in dataclasses.fields(options)}
    fields: dict[str, Any] = {name: None for name, kind in kinds.items() if "None" in kind}
    fields |= {name: tuple(value) if isinstance(value, list) else value for name, value in table.items()}
    for name in (name for name, kind in kinds.items() if "observation" in name and fields.get(name) is not None):
        fields[name] = _named_now(fields[name])
    paths = [name for name, kind in kinds.items() if "Path" in kind and isinstance(fields.get(name), str)]
    fields |= {name: Path(fields[name]) for name in paths}
    with parsing(path / CONFIG, "TOML"):
        for name in (name for name in table if name not in kinds):
            meant = alike(name, kinds)
            fix = f"did you mean {meant}?" if meant else "begin a new run"
            rule = f"an option of this command and version, {__version__}"
            raise InputError(f"options.{name}", table[name], rule, fix)
        for f in dataclasses.fields(options):
            if f.name not in fields and f.default is f.default_factory is dataclasses.MISSING:
                raise InputError(f"options.{f.name}", NOTHING, "a value")
        check_kinds(options, fields, "options.")
        return options(**fields)


def _named_now(observation: str | tuple[str, ...]) -> str | tuple[str, ...]:
    """Return one or several observations of a stored run under the names that they have now."""
    from whiptool.rl.task import OLD_OBSERVATIONS

    if isinstance(observation, tuple):
        return tuple(OLD_OBSERVATIONS.get(name, name) for name in observation)
    return OLD_OBSERVATIONS.get(observation, observation)


def configuration(
    options: OptionGroup, command: str, model: Model | None = None, controller: Controller | None = None, **parts: Any
) -> dict[str, Any]:
    """Return the configuration that a run folder stores: options, model and controller, without the code's version.

    Args:
        options: Options of the command; those that concern only this call (`of_this_call`) are left out.
        command: Name of the command, as in `python -m whiptool.COMMAND`.
        model, controller: Model and controller that the options describe; None: they are stored elsewhere.
        parts: Further resolved parts, as plain TOML data.
    """
    from whiptool.impedance.controller import controller_to_table
    from whiptool.models.files import model_to_table

    config = {"command": command, "options": as_plain(options.kept()), **parts}
    if model is not None:
        config["model"] = model_to_table(model)
    if controller is not None:
        config["controller"] = controller_to_table(controller)
    return config


def new_folder(options: OutputOptions, name: str, config: dict[str, Any]) -> RunFolder:
    """Make the folder of a new run, as `--out` says, or below `runs`.

    Args:
        options: Options that name the folder.
        name: Name of the folder, unless `--out` gives another.
        config: See `configuration`.

    Raises:
        InputError: The folder cannot be made, is not empty, or another process writes in it.
    """
    from whiptool.runs import RunFolder, code_version, default_folder

    check_matplotlib()
    resumable = hasattr(options, "resume")
    with renaming({"run_folder": "run folder"}, fix="give --out"):
        path = options.out or default_folder(name)
    with _out_named(resumable):
        note = _go_on(path) if resumable else ""
        return RunFolder.create(path, {"version": code_version(), **config}, on_interrupt=note)


def check_out(options: OutputOptions) -> None:
    """Refuse an `--out` that `new_folder` would refuse, without changing it.

    Raises:
        InputError: The folder is not empty, or another process writes in it.
    """
    from whiptool.runs import check_new

    if options.out is not None:
        with _out_named(resumable=hasattr(options, "resume")):
            check_new(options.out)


@contextmanager
def _out_named(resumable: bool) -> Iterator[None]:
    from whiptool.runs import FolderTaken

    with renaming({"run_folder": "--out"}):
        try:
            yield
        except FolderTaken as error:
            raise error.renamed(error.name, "to go on with a killed run, give --resume" if resumable else "") from None


def _go_on(path: Path) -> str:
    return f"go on with --resume {path}"


def open_folder(options: ResumableOptions, name: str, config: dict[str, Any]) -> RunFolder:
    """Return the run folder of a command: a new folder, or that of the run to resume.

    Args:
        options: Options that name the folder.
        name: Name of a new folder, unless `--out` names it.
        config: The configuration as it is resolved now, see `configuration`.

    Raises:
        InputError: The folder cannot be made, another process writes in it, or it holds a run with another
            configuration.
    """
    from whiptool.runs import RunFolder

    if options.resume is None:
        return new_folder(options, name, config)
    with renaming({"run_folder": "--resume"}):
        folder = RunFolder.open(options.resume, on_interrupt=_go_on(options.resume))
    check_same_run(folder, config)
    return folder


def check_same_run(folder: RunFolder, config: dict) -> None:
    """Refuse to resume a run whose stored configuration differs from that of its options in this version.

    Raises:
        InputError: A part differs; it is named.
    """
    from whiptool.runs import begun_by

    stored = folder.config
    for part, value in config.items():
        if part == "model" and part in stored:
            value = _as_written(value, stored[part])
        if part != "options" and stored.get(part) != value:  # `parse_resumable` compares these one by one
            fix = f"the {part} differs from when the run began{begun_by(stored)}; begin a new run"
            raise InputError("--resume", str(folder.path), f"a run of the same {part}", fix)


def reads_as(part: str, stored: dict[str, Any], now: dict[str, Any]) -> bool:
    """Return whether a run's stored model or controller equals the present one; keys that older versions did not write,
    and names of joints outside whiptool, may be missing.
    """
    from whiptool.impedance.controller import controller_from_table, controller_to_table
    from whiptool.models.files import model_from_table, model_to_table

    try:
        if part == "model":
            return model_to_table(model_from_table(stored)) == _as_written(now, stored)
        return controller_to_table(controller_from_table(stored)) == now
    except InputError:
        return False


_LABELS = ("names", "rate", "stick")  # keys of an arm that change no simulation, and that older versions left out


def _as_written(now: dict[str, Any], stored: dict[str, Any]) -> dict[str, Any]:
    """The present model without labels of the arm that the stored one does not have."""
    arm = {key: x for key, x in now["arm"].items() if key not in _LABELS or key in stored.get("arm", {})}
    return {**now, "arm": arm}


def check_matplotlib() -> None:
    """Refuse settings with which matplotlib cannot be imported, before anything is computed for its figures.

    Raises:
        InputError: matplotlib refuses its settings; the environment variable or file is named.
    """
    try:
        import matplotlib  # noqa: F401
    except (ValueError, OSError) as error:
        name = "matplotlibrc" if isinstance(error, (UnicodeDecodeError, OSError)) else "MPLBACKEND"
        place = os.environ.get(name, os.environ.get("MATPLOTLIBRC", "matplotlibrc"))
        raise InputError(name, place, "settings that matplotlib takes", f"reason: {str(error)[:160]}") from None


def as_plain(options: Any) -> dict:
    """Return options as plain TOML data, without those that are None."""
    plain = {}
    for f in dataclasses.fields(options):
        value = getattr(options, f.name)
        if isinstance(value, os.PathLike):
            plain[f.name] = os.path.abspath(value)  # noqa: PTH100
        elif value is not None:
            plain[f.name] = list(value) if isinstance(value, tuple) else value
    for name in ("model", "arm", "controller"):
        if str(plain.get(name, "")).endswith((".toml", ".urdf", ".xml")):  # the same file, wherever the run is resumed
            plain[name] = os.path.abspath(plain[name])  # noqa: PTH100
    return plain


def folder_of(policy: Path) -> Path:
    """Return the run folder of a policy, given that folder or a policy file in it."""
    return policy.parent if policy.is_file() else policy


def is_policy(path: Path) -> bool:
    """Whether the path is a run of `train` that has saved a policy."""
    from whiptool.rl.trained import BEST, CHECKPOINT
    from whiptool.runs import CONFIG, read_config

    folder = folder_of(path)
    holds = any((folder / name).is_file() for name in (BEST, CHECKPOINT))
    return holds and (folder / CONFIG).is_file() and read_config(folder).get("command") == "train"
