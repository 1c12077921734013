"""Functions that all command lines share: parsing, run folders, and errors in one line."""

from __future__ import annotations

import dataclasses
import errno
import io
import json
import os
import pathlib
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from types import NoneType, UnionType
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar, Union, get_args, get_origin, get_type_hints

from whiptool.commands.help import HELP, HELP_ALL, help_text
from whiptool.commands.interruptions import INTERRUPTED, Interruptions, with_state
from whiptool.commands.options.option_group import (
    JsonOptions,
    OptionGroup,
    OutputOptions,
    ResumableOptions,
    flag,
    names_of,
    of_run,
    options_named,
    renaming,
)
from whiptool.commands.spelling import choices, usual_words
from whiptool.errors import NOTHING, InputError, WhiptoolError, alike
from whiptool.extras import require
from whiptool.progress import Progress
from whiptool.version import __version__

if TYPE_CHECKING:
    from pathlib import Path

    from whiptool.impedance import Controller
    from whiptool.models import Model
    from whiptool.runs import RunFolder

T = TypeVar("T", bound=OptionGroup)
_LONGEST_WORD, _DEEPEST = 4000, 200  # [characters], [folders]
_COUNTS = {2: "two", 3: "three"}


def parse(options: type[T], *, prog: str, description: str, args: Sequence[str] | None, default: T | None = None) -> T:
    """Return the command line as an instance of the frozen dataclass `options`.

    An option that takes several values needs at least one, unless the class names it in `may_be_empty`.

    Raises:
        InputError: The command line cannot be parsed, an option is given twice, a package that it needs is missing, or
            a value is not allowed; the option is named.
        SystemExit: `--help` or `--help-all` was printed.
    """
    parsed = _parsed(options, prog=prog, description=description, args=args, default=default)
    Progress.quiet = getattr(parsed, "quiet", False)
    require(prog.removeprefix("whiptool "), parsed.needs())
    with options_named(parsed):
        parsed.check()
    return parsed


def _parsed(
    options: type[T], *, prog: str, description: str, args: Sequence[str] | None, default: T | None = None
) -> T:
    """As `parse`, values not checked: those of a run to be resumed are in its folder."""
    words = usual_words(sys.argv[1:] if args is None else args, options)
    _check_words(words)
    if {*HELP, HELP_ALL} & set(words):
        known = _known(options, [word for word in words if word not in (*HELP, HELP_ALL)])
        print(help_text(known, prog=prog, description=description, whole=HELP_ALL in words))
        raise SystemExit(0)
    return _typed(options, words, default)


def _known(options: type[T], words: list[str]) -> T:
    """Return options as far as words give them; where these are wrong, as if none were given."""
    if words:
        try:
            return _typed(options, words)
        except (InputError, SystemExit):
            pass
    found = object.__new__(options)
    for f in dataclasses.fields(options):
        object.__setattr__(found, f.name, None if f.default is dataclasses.MISSING else f.default)
    return found


def _typed(options: type[T], words: list[str], default: T | None = None) -> T:
    """Return the options that words give, or the error of the first that is wrong."""
    import tyro
    from tyro import _errors as tyro_errors

    def refuse(event: Any) -> None:
        raise _refusal(event, options, words)

    given = given_flags(words)
    with tyro_errors.on_parse_error(refuse):
        extra: dict[str, Any] = {} if default is None else {"default": default}
        parsed = tyro.cli(options, args=words, add_help=False, **extra)
    for f in dataclasses.fields(parsed):
        needs = f.name not in options.named("may_be_empty")
        if needs and flag(f.name) in given and getattr(parsed, f.name) == ():
            raise InputError(flag(f.name), NOTHING, "one value or more")
    return _spelled(parsed, given)


def _spelled(parsed: T, given: Sequence[str]) -> T:
    """Return options with the names that are given in the spelling of the library, which has to know them."""
    found: dict[str, Any] = {}
    for name, kind in get_type_hints(type(parsed), include_extras=True).items():
        if flag(name) in given and (names := names_of(kind)):
            value, option = getattr(parsed, name), flag(name)
            one = isinstance(value, str)
            found[name] = names.name(option, value) if one else tuple(names.name(option, x) for x in value or ())
    return dataclasses.replace(parsed, **found) if found else parsed


def _refusal(event: Any, options: type[OptionGroup], words: list[str]) -> InputError:
    """Return the error that says what tyro found wrong."""
    from tyro import _errors as tyro_errors

    argument: Any = getattr(event, "argument", None)
    name = argument.lowered.name_or_flags[0] if argument is not None else "command line"
    if isinstance(event, tyro_errors.UnrecognizedArgs):
        unknown = next((x for x in event.tokens if x.startswith("-")), "command line")
        return InputError(unknown, " ".join(event.tokens), "the options that --help lists", _meant(unknown, options))
    if isinstance(event, tyro_errors.MissingArgs):
        return _missing(event.missing_arguments[0].arg)
    if isinstance(event, tyro_errors.InvalidChoice):
        allowed = choices(get_type_hints(options)[event.argument.field.intern_name])
        return InputError(name, event.value, ", ".join(map(str, allowed)))
    if isinstance(event, tyro_errors.BadValue):
        given = NOTHING if event.offending_value is None else event.offending_value
        return InputError(name, given, "a value (see --help)")
    if isinstance(event, tyro_errors.InstantiationFailure) and argument is not None:
        kind = get_type_hints(options, include_extras=True).get(argument.field.intern_name)
        return InputError(name, _given(name, words), _kind_in_words(kind))
    return InputError("command line", " ".join(words), "options and values as in --help")


def _check_words(words: Sequence[str]) -> None:
    """Refuse words that are not text in the terminal's encoding, and words that are too long for a path.

    Raises:
        InputError: There is such a word.
    """
    for word in words:
        if len(word) > _LONGEST_WORD or word.count("/") > _DEEPEST:
            rule = f"words of at most {_LONGEST_WORD} characters, paths of at most {_DEEPEST} folders"
            raise InputError("command line", word, rule)
        if any("\ud800" <= x <= "\udfff" for x in word):
            raise InputError("command line", word, "text in the terminal's encoding", "export LC_ALL=C.UTF-8")


def _kind_in_words(kind: Any) -> str:
    """Return what an option of a type takes, such as `a number` or `two of miss, effort`."""
    if get_origin(kind) in (UnionType, Union):
        return _kind_in_words(next(part for part in get_args(kind) if part is not NoneType))
    registered = names_of(kind)
    if get_origin(kind) is tuple:
        parts = get_args(kind)
        names = ", ".join(registered.known() if registered else map(str, choices(parts[0])))
        count = "" if Ellipsis in parts else f"{_COUNTS.get(len(parts), len(parts))} "
        return f"{count or 'one or more '}of {names}" if names else f"{count}numbers with a space or comma between them"
    names = ", ".join(registered.known() if registered else map(str, choices(kind)))
    return names or {int: "a whole number", float: "a number"}.get(kind, "a value of its type")


def _meant(unknown: str, options: type[OptionGroup]) -> str:
    """Return the question which option was meant; empty where none is like what was given.

    `--zone` is short for `--zone-radius`, and `--no-videos` a misspelling of `--no-video`.
    """
    kinds = get_type_hints(options)
    known = ["help", HELP_ALL[2:], *(flag(f.name)[2:] for f in dataclasses.fields(options))]
    known += [f"no-{name}" for name in known if kinds.get(name.replace("-", "_")) is bool]
    given = unknown.split("=")[0].replace("_", "-").lstrip("-")
    longer = [name for name in known if set(given.split("-")) <= set(name.split("-"))]
    meant = longer[:3] or [name for name in [alike(given, known)] if name]
    return f"did you mean {' or '.join(f'--{name}' for name in meant)}?" if meant else ""


def _missing(argument: Any) -> InputError:
    """Return the error that says which argument is missing, and what it means."""
    field = argument.field
    positional = field.argconf.metavar or field.intern_name.upper()
    name = positional if argument.is_positional() else argument.lowered.name_or_flags[0]
    meaning = field.helptext() if callable(field.helptext) else field.helptext
    return InputError(name, NOTHING, (meaning or "a value").rstrip("."), "--help tells more")


def given_flags(words: Sequence[str]) -> list[str]:
    """Return the options on a command line, `--no-video` as `--video`.

    Raises:
        InputError: An option is given twice.
    """
    found: list[str] = []
    for word in words:
        if word.startswith("--"):
            given = flag(word.split("=")[0].removeprefix("--").replace("_", "-").removeprefix("no-"))
            if given in found:
                raise InputError(given, "twice", "an option once")
            found.append(given)
    return found


def parse_resumable(
    options: type[T],
    *,
    command: str,
    description: str,
    args: Sequence[str] | None,
    quick: Mapping[str, Any] | None = None,
    prog: str = "",
) -> T:
    """Parse the command line of a command with `--out` and `--resume`; a resumed run's options come from its folder.

    Options that the class lists as `changeable` may be given again; all others have to be as stored.

    Args:
        options: Class of the options, with fields `out` and `resume`.
        command: Name of the command, as in `python -m whiptool.COMMAND`.
        description, args: As in `parse`.
        quick: Values that `--quick` sets where an option is not given.
        prog: Name of the command in help and errors; default: `whiptool COMMAND`.

    Raises:
        InputError: The folder is of another command, or an option given with `--resume` differs from the stored one.
    """
    prog, words = prog or f"whiptool {command}", list(sys.argv[1:] if args is None else args)
    parsed: Any = _parsed(options, prog=prog, description=description, args=words)
    if parsed.resume is None:
        small: Any = None
        if quick and parsed.quick:
            mine = {f.name for f in dataclasses.fields(parsed)}
            small = options(**{name: value for name, value in quick.items() if name in mine})
        return parse(options, prog=prog, description=description, args=words, default=small)
    with renaming({"run_folder": "--resume"}):
        stored: Any = options_of_run(options, parsed.resume, command=command)
    try:
        again: Any = parse(options, prog=prog, description=description, args=words, default=stored)
    except InputError as error:
        raise error if error.name in given_flags(words) else of_run(error, parsed.resume) from None
    if again.out is not None:
        raise InputError("--out", str(again.out), "only without --resume: a resumed run stays in its folder")
    now, begun = as_plain(again), as_plain(stored)
    fixed = {f.name for f in dataclasses.fields(again)} - options.named("of_this_call") - options.named("changeable")
    for name in sorted(fixed):
        if now.get(name) != begun.get(name):
            raise InputError(
                flag(name),
                now.get(name),
                f"{begun.get(name)!r}, as the run was begun",
                "leave it out, or start a new run",
            )
    return again


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
    kinds = {f.name: str(f.type) for f in dataclasses.fields(options)}
    fields: dict[str, Any] = {name: None for name, kind in kinds.items() if "None" in kind}
    fields |= {name: tuple(value) if isinstance(value, list) else value for name, value in table.items()}
    for name in (name for name, kind in kinds.items() if "observation" in name and fields.get(name) is not None):
        fields[name] = _named_now(fields[name])
    paths = [name for name, kind in kinds.items() if "Path" in kind and fields.get(name) is not None]
    try:
        fields |= {name: pathlib.Path(fields[name]) for name in paths}
        return options(**fields)
    except TypeError as error:
        raise InputError("--resume", str(path), f"a folder of this command and version ({error})") from None


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
    """Return the run folder of a command: a new one, or that of the run to resume.

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
        if part != "options" and stored.get(part) != value:  # `parse_resumable` compares these one by one
            fix = f"the {part} differs from when the run began{begun_by(stored)}; begin a new run"
            raise InputError("--resume", str(folder.path), f"a run of the same {part}", fix)


def reads_as(part: str, stored: dict[str, Any], now: dict[str, Any]) -> bool:
    """Return whether a run's stored model or controller is the present one; older versions wrote fewer keys."""
    from whiptool.impedance.controller import controller_from_table, controller_to_table
    from whiptool.models.files import model_from_table, model_to_table

    try:
        if part == "model":
            return model_to_table(model_from_table(stored)) == now
        return controller_to_table(controller_from_table(stored)) == now
    except InputError:
        return False


def _given(flag: str, words: list[str]) -> str:
    """What stood behind a flag on the command line."""
    joined = next((word for word in words if word.startswith(flag + "=")), None)
    if joined is not None:
        return joined.partition("=")[2]
    if flag not in words:
        return ""
    behind = words[words.index(flag) + 1 :]
    return " ".join(behind[: next((i for i, word in enumerate(behind) if word.startswith("--")), len(behind))])


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
        raise InputError(name, place, f"settings that matplotlib takes ({str(error)[:160]})") from None


def run(command: Callable[[], int]) -> int:
    """Run a command and return its exit status; bad input is reported in one line on stderr (2), a signal gives 130."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # letters that the terminal's encoding lacks do not stop it
            stream.reconfigure(errors="backslashreplace")
    Progress.quiet = False
    with Interruptions() as interruptions:
        try:
            return command()
        except InputError as error:
            _say(error)
            return 2
        except BrokenPipeError:  # the reader of our output went away
            sys.stdout = open(os.devnull, "w")  # noqa: SIM115, PTH123
            return 1
        except (WhiptoolError, OSError, MemoryError) as error:
            if isinstance(error, OSError) and error.errno == errno.ENAMETOOLONG:
                _say(InputError("path", error.filename, "a shorter name"))
                return 2
            _say(error)
            return 1
        except (KeyboardInterrupt, Exception) as stop:
            # CasADi drops a signal's exception that comes while it converts arguments, and something else fails then
            if not (interruptions.came or isinstance(stop, KeyboardInterrupt)):
                raise
            interruptions.end()
            print(with_state(_line(stop, "interrupted")), file=sys.stderr)
            return INTERRUPTED
        finally:
            Progress.quiet = False  # of this command alone


def _say(error: BaseException) -> None:
    """One line on stderr: an error and its notes."""
    print(_line(error), file=sys.stderr)


def _line(error: BaseException, what: str = "") -> str:
    """An error and its notes in one line."""
    said = what or " ".join(str(error).split()) or type(error).__name__
    return "; ".join([f"whiptool: {said}", *getattr(error, "__notes__", [])])


Main: TypeAlias = Callable[..., int]  # of the words of a command line; default: those that the process was called with


def command(
    options: type[T],
    name: str,
    about: str,
    work: Callable[[T], int],
    *,
    prog: str = "",
    quick: Mapping[str, Any] | None = None,
    of_run: Callable[[Path], T] | None = None,
    named: Mapping[str, str] | None = None,
) -> Main:
    """Return the `main` of a command: it parses a command line, does the work, and returns the exit status of `run`.

    Args:
        options: Class of its options; with `resume` they are those of `parse_resumable`.
        name, about: Name, as in `python -m whiptool.NAME`, and description of the command.
        work: Does what checked options ask for, and returns the exit status.
        prog: Name of the command in help and errors; default: `whiptool NAME`.
        quick: Values that `--quick` sets where an option is not given.
        of_run: Gives the options of the run folder in their positional field `run`, which hold unless they are given.
        named: Options by names of the library that are not their own.
    """
    how: dict[str, Any] = {"prog": prog or f"whiptool {name}", "description": about}

    def parsed(args: Sequence[str] | None) -> T:
        if issubclass(options, ResumableOptions):
            return parse_resumable(options, command=name, args=args, quick=quick, **how)
        if of_run is None:
            return parse(options, args=args, **how)
        given: Any = _parsed(options, args=args, **how)
        return parse(options, args=args, default=None if given.run is None else of_run(given.run), **how)

    def called(args: Sequence[str] | None) -> int:
        found = parsed(args)
        with options_named(found, **named or {}):
            return work(found)

    return lambda args=None: run(lambda: called(args))


def subcommands(name: str, mains: Mapping[str, tuple[str, Main]], note: str = "") -> Main:
    """Return the `main` of a command whose first word is the name of a subcommand.

    Args:
        name: Name of the command.
        mains: Description and `main` of each subcommand.
        note: Last line of `--help`.
    """

    def main(args: Sequence[str] | None = None) -> int:
        words = list(sys.argv[1:] if args is None else args)
        if words[:1] in (["-h"], ["--help"]):
            print(f"usage: whiptool {name} {'|'.join(mains)} [options]\n")
            print("\n".join(f"  {word:8s} {what}" for word, (what, _) in mains.items()) + note)
            return 0
        if not words or words[0] not in mains:
            fix = f"such as `whiptool {name} {next(iter(mains))} --help`"
            return run(lambda: _unknown(name, " ".join(words[:1]), mains, fix))
        return mains[words[0]][1](words[1:])

    return main


def tell(options: JsonOptions, summary: Mapping[str, Any], text: str) -> None:
    """Print a result: one JSON object, or lines of text."""
    print(json.dumps(summary, allow_nan=False) if options.json else text, flush=True)


COMMANDS = {
    "optimize": "find a strike that hits a target",
    "identify": "fit a whip's parameters to recorded strikes",
    "adapt": "identify an unknown whip, strike by strike, until it hits",
    "train": "train a policy over a zone of targets",
    "compare": "compare the numbers of trials that methods need until a hit",
    "reproduce": "reproduce the paper's figures and tables in one report",
    "human": "compare people's whip throws with planned strikes",
    "map": "find the strike for any goal of a region, without a search",
    "simulate": "play one strike, or export the model",
    "view": "show a run: viewer, video, interactive page, report",
    "rig": "strike with a real arm, or with its simulated twin",
    "doctor": "check the installation and this machine",
}


def main() -> int:
    """Run `whiptool COMMAND ...`, which is the same as `python -m whiptool.COMMAND ...`."""
    from importlib import import_module

    args = sys.argv[1:]
    if args[:1] == ["--version"]:
        print(f"whiptool {__version__}")
        return 0
    if not args or args[0] in ("-h", "--help"):
        print("usage: whiptool COMMAND [options]\n")
        print("\n".join(f"  {name:10s} {what}" for name, what in COMMANDS.items()))
        print("\n`whiptool COMMAND --help` lists a command's options; `whiptool --version` prints the version.")
        return 0
    if args[0] not in COMMANDS:
        return run(lambda: _unknown("command", args[0], COMMANDS))
    return import_module(f"whiptool.commands.{args[0]}").main(args[1:])


def _unknown(name: str, given: str, known: Iterable[str], fix: str = "") -> int:
    raise InputError(name, given, ", ".join(known), fix)


def as_plain(options: Any) -> dict:
    """Return options as plain TOML data, without those that are None."""
    plain = {}
    for f in dataclasses.fields(options):
        value = getattr(options, f.name)
        if isinstance(value, os.PathLike):
            plain[f.name] = os.path.abspath(value)  # noqa: PTH100
        elif value is not None:
            plain[f.name] = list(value) if isinstance(value, tuple) else value
    for name in ("model", "controller"):
        if str(plain.get(name, "")).endswith(".toml"):  # the same file, wherever the run is resumed
            plain[name] = os.path.abspath(plain[name])  # noqa: PTH100
    return plain
