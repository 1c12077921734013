"""Functions of all commands: parsing, running, errors in one line, and an orderly end after Ctrl-C or SIGTERM."""

from __future__ import annotations

import dataclasses
import errno
import io
import os
import signal
import sys
import textwrap
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from importlib import import_module
from types import FrameType
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar

from whiptool.commands.help import help_text
from whiptool.commands.options.option_group import (
    HELP,
    HELP_ALL,
    OptionGroup,
    ResumableOptions,
    flag,
    of_run,
    options_named,
    renaming,
)
from whiptool.commands.parsing import check_words, given_flags, options_from, partial_options, usual_words
from whiptool.commands.run_folders import as_plain, options_of_run
from whiptool.errors import InputError, WhiptoolError
from whiptool.extras import require
from whiptool.progress import Progress
from whiptool.stop_signals import INTERRUPTED, Listener
from whiptool.version import __version__

if TYPE_CHECKING:
    from pathlib import Path

T = TypeVar("T", bound=OptionGroup)
TOGETHER = 0.5  # [s] signals of one kind within this time are one: `timeout` tells a process, and then its group
_SIGNALS = (signal.SIGINT, signal.SIGTERM)
_state: list[Callable[[], str]] = []  # of the command that runs


def tell_when_interrupted(state: Callable[[], str]) -> None:
    """Set a function whose text is added to the command's last line if a signal ends it, such as whether torque is
    off."""
    _state[:] = [state]


def with_state(said: str) -> str:
    """Return the last line of an interrupted command with the texts of `tell_when_interrupted` added, each once."""
    return "; ".join([said, *(state for tell in _state if (state := tell()) not in said)])


class Interruptions(Listener):
    """Signal handlers of a command, installed within a `with` block.

    The first signal raises KeyboardInterrupt. A second one, while the command saves and ends, ends the process at once;
    an exception would interrupt the clean-up with a traceback. Signals of the same kind that arrive together with the
    first count as one. While servos may be on, the handlers of `whiptool.stop_signals` replace these, so that
    torque-off is completed; they call `note`.

    Args:
        clock: Function that returns the present time [s].
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock, self._over, self._ended = clock, False, False
        self._first: tuple[int, float] | None = None  # which signal, and when
        self._before: dict[int, Any] = {}

    @property
    def came(self) -> bool:
        """Whether a signal has come."""
        return self._first is not None

    def note(self, number: int) -> None:
        """Record a signal that has already interrupted the command, so that the next one counts as the second."""
        self._first = self._first or (number, self._clock())

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        if self._first is None:
            self.note(number)
            raise KeyboardInterrupt
        first, came = self._first
        if number == first and self._clock() - came <= TOGETHER:
            return
        if self._ended:  # a third signal while the second one is answered
            return
        self._ended = True
        os.write(2, (with_state("whiptool: ended at once by a second signal") + "\n").encode())
        os._exit(INTERRUPTED)

    def end(self) -> None:
        """Ignore further signals: all results are saved, and the process is about to end."""
        self._over = True
        for number in self._before:
            signal.signal(number, signal.SIG_IGN)  # also while the interpreter ends
        # CPython remembers that a signal came while it ran code from a text (any dataclass or named tuple of a library
        # that is being imported) and would kill this process by SIGINT at its end, until other such code has run.
        exec("")

    def __enter__(self) -> Interruptions:
        _state.clear()
        heard = [n for n in _SIGNALS if signal.getsignal(n) != signal.SIG_IGN]  # a shell's background jobs ignore some
        self._before = {number: signal.signal(number, self._on_signal) for number in heard}
        return self

    def __exit__(self, *_: object) -> None:
        if not self._over:
            for number, handler in self._before.items():
                signal.signal(number, handler)


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
    check_words(words)
    if {*HELP, HELP_ALL} & set(words):
        known = partial_options(options, [word for word in words if word not in (*HELP, HELP_ALL)])
        print(help_text(known, prog=prog, description=description, whole=HELP_ALL in words))
        raise SystemExit(0)
    return options_from(options, words, default)


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
    try:
        with renaming({"run_folder": "--resume"}):
            stored: Any = options_of_run(options, parsed.resume, command=command)
    except InputError as error:
        raise error if error.name == "--resume" else error.within("--resume ") from None
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


def run(command: Callable[[], int]) -> int:
    """Run a command and return its exit status: 2 for bad input, which is reported in one line on stderr, and 130 after
    a signal.
    """
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # letters that the terminal's encoding lacks do not stop it
            stream.reconfigure(errors="backslashreplace")
    Progress.quiet = False
    with Interruptions() as interruptions:
        try:
            status = command()
            if interruptions.came or status == INTERRUPTED:  # it answered the signal itself
                interruptions.end()
            return status
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
        options: Class of the command's options; subclasses of `ResumableOptions` are parsed by `parse_resumable`.
        name, about: Name, as in `python -m whiptool.NAME`, and description of the command.
        work: Function that executes the command with checked options, and returns the exit status.
        prog: Name of the command in help and errors; default: `whiptool NAME`.
        quick: Values that `--quick` sets where an option is not given.
        of_run: Function that returns the options stored in a run folder, which the positional option `run` names; they
            apply where an option is not given. None: there is no such folder.
        named: Options whose names differ from the library's, by the library's names.
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


def _listed(line: str) -> list[str]:
    """Return the lines of a subcommand and its description, which continues below its own beginning."""
    return textwrap.wrap(line, 100, subsequent_indent=" " * 11)


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
            lines = (line for word, (what, _) in mains.items() for line in _listed(f"  {word:8s} {what}"))
            print("\n".join(lines) + note)
            return 0
        if not words or words[0] not in mains:
            fix = f"such as `whiptool {name} {next(iter(mains))} --help`"
            return run(lambda: _unknown(name, " ".join(words[:1]), mains, fix))
        return mains[words[0]][1](words[1:])

    return main


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
    "studio": "open a page on which a target is dragged, and the strike follows",
    "recording": "show what was understood of recordings, and convert them",
    "view": "show a run: viewer, video, interactive page, report",
    "rig": "strike with servos, or with their simulated twin",
    "robot": "strike with a Franka, a UR or another robot of yours",
    "doctor": "check the installation and this machine",
}
_MAINS = {  # module and function of commands that share a module
    "reproduce": ("papers", "reproduce"),
    "human": ("papers", "human"),
    "dynamixel": ("servos", "main"),
    "emulator": ("emulators", "servos"),
    "ur_emulator": ("emulators", "ur"),
}


def main() -> int:
    """Run `whiptool COMMAND ...`, which is the same as `python -m whiptool.COMMAND ...`."""
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
    return main_of(args[0])(args[1:])


def main_of(name: str) -> Main:
    """Return the `main` of a command of `COMMANDS`, or of one of `whiptool.rig`."""
    module, main = _MAINS.get(name, (name, "main"))
    return getattr(import_module(f"whiptool.commands.{module}"), main)


def _unknown(name: str, given: str, known: Iterable[str], fix: str = "") -> int:
    raise InputError(name, given, ", ".join(known), fix)
