"""What the command lines share: parsing, and errors as one line."""

from __future__ import annotations

import dataclasses
import os
import signal
import sys
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypeVar

from whiptool.errors import NOTHING, InputError, WhiptoolError
from whiptool.options import Options
from whiptool.version import __version__

if TYPE_CHECKING:
    from pathlib import Path

    from whiptool.runs import RunFolder

T = TypeVar("T", bound=Options)


def parse(options: type[T], *, prog: str, description: str, args: Sequence[str] | None, default: T | None = None) -> T:
    """The command line as an instance of a frozen dataclass.

    An option that takes several values is not given without one, unless the class names it in `may_be_empty`.

    Raises:
        InputError: It does not parse, an option is there twice, or a value breaks a rule of its own; it is named.
        SystemExit: `--help` was printed.
    """
    return _checked(_parsed(options, prog=prog, description=description, args=args, default=default))


def _parsed(
    options: type[T], *, prog: str, description: str, args: Sequence[str] | None, default: T | None = None
) -> T:
    """As `parse`, values not checked: those of a run to be resumed are in its folder."""
    import tyro
    from tyro import _errors as tyro_errors

    words = list(sys.argv[1:] if args is None else args)

    def refuse(event: Any) -> None:
        argument = getattr(event, "argument", None)
        name = argument.lowered.name_or_flags[0] if argument is not None else "command line"
        if isinstance(event, tyro_errors.UnrecognizedArgs):
            flag = next((x for x in event.tokens if x.startswith("--")), "command line")
            raise InputError(flag, " ".join(event.tokens), "the options that --help lists")
        if isinstance(event, tyro_errors.MissingArgs):
            raise _missing(event.missing_arguments[0].arg)
        if isinstance(event, tyro_errors.InvalidChoice):
            raise InputError(name, event.value, ", ".join(event.choices))
        if isinstance(event, tyro_errors.BadValue):
            given = NOTHING if event.offending_value is None else event.offending_value
            raise InputError(name, given, "a value (see --help)")
        if isinstance(event, tyro_errors.InstantiationFailure):
            raise InputError(name, _given(name, words), "a value of its type", event.message)
        raise InputError("command line", " ".join(words), "what --help shows")

    flags = _flags(words)
    with tyro_errors.on_parse_error(refuse):
        extra: dict[str, Any] = {} if default is None else {"default": default}
        parsed = tyro.cli(options, prog=prog, description=description, args=words, **extra)
    for f in dataclasses.fields(parsed):
        flag, needs = "--" + f.name.replace("_", "-"), f.name not in getattr(options, "may_be_empty", ())
        if needs and flag in flags and getattr(parsed, f.name) == ():
            raise InputError(flag, NOTHING, "one value or more")
    return parsed


def _missing(argument: Any) -> InputError:
    """Return the error that says which argument is missing, and what it means."""
    field = argument.field
    name = field.argconf.metavar if argument.is_positional() else argument.lowered.name_or_flags[0]
    meaning = field.helptext() if callable(field.helptext) else field.helptext
    return InputError(name, NOTHING, (meaning or "a value").rstrip("."), "--help tells more")


def _checked(options: T) -> T:
    """The same options.

    Raises:
        InputError: A value breaks a rule of its own; the option is named.
    """
    try:
        options.check()
    except InputError as error:
        name = error.name.replace(" ", "_")  # what the library calls an argument
        if name not in {f.name for f in dataclasses.fields(options)}:
            raise
        raise InputError("--" + name.replace("_", "-"), error.given, error.allowed, error.fix) from None
    return options


def _flags(words: Sequence[str]) -> list[str]:
    """The options on a command line, `--no-video` as `--video`.

    Raises:
        InputError: One is there twice; only the last would count.
    """
    flags: list[str] = []
    for word in words:
        if word.startswith("--"):
            flag = "--" + word.split("=")[0].removeprefix("--").replace("_", "-").removeprefix("no-")
            if flag in flags:
                raise InputError(flag, "twice", "an option once")
            flags.append(flag)
    return flags


def parse_resumable(
    options: type[T],
    *,
    command: str,
    description: str,
    args: Sequence[str] | None,
    not_configuration: dict[str, Any],
    changeable: Sequence[str] = (),
    quick: Mapping[str, Any] | None = None,
) -> T:
    """As `parse`, for a command with `--out` and `--resume`: a resumed run's options come from its folder.

    Args:
        options: Their class, with fields `out` and `resume`.
        command: Its name, as in `python -m whiptool.COMMAND`.
        description, args: As in `parse`.
        not_configuration: Options of this call alone, which the folder does not hold, and their defaults.
        changeable: Options that do not make the run another one: they are as in the folder, unless they are given anew.
        quick: Values that `--quick` sets where an option is not given.

    Raises:
        InputError: The folder is of another command, or an option given beside `--resume` differs from the stored one.
    """
    from whiptool.runs import read_config

    prog, words = f"whiptool {command}", list(sys.argv[1:] if args is None else args)
    parsed: Any = _parsed(options, prog=prog, description=description, args=words)
    if parsed.resume is None:
        if not quick or not parsed.quick:
            return _checked(parsed)
        mine = {f.name for f in dataclasses.fields(parsed)}
        small: Any = options(**{name: value for name, value in quick.items() if name in mine})
        return parse(options, prog=prog, description=description, args=words, default=small)
    config = read_config(parsed.resume)
    table = config.get("options")
    if config.get("command") != command or not isinstance(table, dict):
        raise InputError("--resume", str(parsed.resume), f"a folder that `{prog}` made, its config whole")
    stored: Any = stored_options(options, table, parsed.resume)
    again: Any = parse(options, prog=prog, description=description, args=words, default=stored)
    if again.out is not None:
        raise InputError("--out", str(again.out), "nothing beside --resume: a resumed run stays in its folder")
    now, begun = as_plain(again), as_plain(stored)
    for name in {f.name for f in dataclasses.fields(again)} - {*not_configuration, *changeable}:
        if now.get(name) != begun.get(name):
            raise InputError(
                f"--{name.replace('_', '-')}",
                now.get(name),
                f"{begun.get(name)!r}, as the run was begun",
                "leave it out, or start a new run",
            )
    return again


def stored_options(options: type[T], table: dict[str, Any], path: Path) -> T:
    """The options that a run folder holds; what may be None and is not there was None, as TOML has no such value.

    Raises:
        InputError: They are not the options of this command.
    """
    fields: dict[str, Any] = {f.name: None for f in dataclasses.fields(options) if "None" in str(f.type)}
    fields |= {name: tuple(value) if isinstance(value, list) else value for name, value in table.items()}
    try:
        return options(**fields)
    except TypeError as error:
        raise InputError("--resume", str(path), f"a folder of this command and version ({error})") from None


def open_folder(options: Any, name: str, config: dict) -> RunFolder:
    """The folder that a command writes its run in: a new one, or that of the run to resume.

    Args:
        options: With fields `out` and `resume`.
        name: Of a new folder, unless `--out` names it.
        config: The configuration as it is resolved now, without the version of the code.

    Raises:
        InputError: It cannot be made, another process writes in it, or it holds a run with another configuration.
    """
    from whiptool.runs import RunFolder, code_version, default_folder

    if options.resume is None:
        return RunFolder.create(
            options.out or default_folder(name), {"version": code_version(), **config}, resumable=True
        )
    folder = RunFolder.open(options.resume)
    check_same_run(folder, config)
    return folder


def check_same_run(folder: RunFolder, config: dict) -> None:
    """Refuse to go on with a run whose configuration, as it would be resolved now, is not what it was.

    Raises:
        InputError: A part differs; it is named.
    """
    stored = folder.config
    for part, value in config.items():
        if part != "options" and stored.get(part) != value:  # `parse_resumable` compares these one by one
            raise InputError(
                "--resume",
                str(folder.path),
                f"a run of the same {part}",
                f"the {part} is not what it was when the run was begun",
            )


def _given(flag: str, words: list[str]) -> str:
    """What stood behind a flag on the command line."""
    if flag not in words:
        return ""
    behind = words[words.index(flag) + 1 :]
    return " ".join(behind[: next((i for i, word in enumerate(behind) if word.startswith("--")), len(behind))])


def run(command: Callable[[], int]) -> int:
    """Run a command: its exit status, bad input being one line on stderr and status 2."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # end as by Ctrl-C: save and summarise
    try:
        return command()
    except InputError as error:
        print(f"whiptool: {error}", file=sys.stderr)
        return 2
    except BrokenPipeError:  # the reader of our output went away
        sys.stdout = open(os.devnull, "w")  # noqa: SIM115, PTH123
        return 1
    except (WhiptoolError, OSError, MemoryError) as error:
        print(f"whiptool: {' '.join(str(error).split()) or type(error).__name__}", file=sys.stderr)
        return 1
    except KeyboardInterrupt as interruption:
        print("; ".join(["whiptool: interrupted", *getattr(interruption, "__notes__", [])]), file=sys.stderr)
        return 130


COMMANDS = {
    "optimize": "find a strike that hits a target",
    "identify": "fit a whip's parameters to recorded strikes",
    "adapt": "learn an unknown whip, strike by strike",
    "train": "train a policy over a zone of targets",
    "compare": "trials to hit, method by method",
    "reproduce": "the paper's figures and tables as one report",
    "simulate": "play one strike, or export the model",
    "view": "look at a run: viewer, video, interactive page",
    "rig": "strike with a rig, or with its twin",
    "doctor": "check the installation and this machine",
}


def main() -> int:
    """`whiptool COMMAND ...`: the same as `python -m whiptool.COMMAND ...`."""
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
        return run(lambda: _unknown(args[0]))
    return import_module(f"whiptool.commands.{args[0]}").main(args[1:])


def _unknown(command: str) -> int:
    raise InputError("command", command, ", ".join(COMMANDS))


def degrees(radians: float) -> str:
    """An angle for people: rad, and degrees beside it."""
    return f"{radians:+.4f} rad ({radians * 57.29577951308232:+.1f} deg)"


def as_plain(options: Any) -> dict:
    """Options as plain TOML data; what is None is left out."""
    plain = {}
    for f in dataclasses.fields(options):
        value = getattr(options, f.name)
        if value is not None:
            plain[f.name] = list(value) if isinstance(value, tuple) else value
    for name in ("model", "controller"):
        if str(plain.get(name, "")).endswith(".toml"):  # the same file, wherever the run is resumed
            plain[name] = os.path.abspath(plain[name])  # noqa: PTH100
    return plain
