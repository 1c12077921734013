"""Base of all groups of options: checks, conditions under which options have an effect, and options stored with a
run.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, fields, replace
from importlib import import_module
from json import dumps
from pathlib import Path
from typing import Any, ClassVar, Self, TypeAlias, get_args

from whiptool.errors import InputError
from whiptool.extras import Registry
from whiptool.words import as_named

MANY, MANY_TARGETS = 2**31 - 1, 1_000_000
HELP, HELP_ALL = ("-h", "--help"), "--help-all"


@dataclass(frozen=True, init=False)
class Names:
    """Annotation of an option whose value is a name in registries, which are loaded when a name is looked up.

    Args:
        homes: Module and name of each registry, such as `whiptool.goals.criteria:CRITERIA`.
        others: Further names, which are not in a registry.
        without: Names that the option does not take.
        beside: Alternative to a name, as help shows it, such as `|FILE.toml`; names are then not checked here. None:
            only names, which are checked.
    """

    homes: tuple[str, ...]
    others: tuple[str, ...]
    without: tuple[str, ...]
    beside: str | None

    def __init__(
        self, *homes: str, others: tuple[str, ...] = (), without: tuple[str, ...] = (), beside: str | None = None
    ) -> None:
        for name, value in (("homes", homes), ("others", others), ("without", without), ("beside", beside)):
            object.__setattr__(self, name, value)

    @property
    def registries(self) -> list[Any]:
        """The registries that `homes` names; they may also be tuples or dictionaries of names."""
        return [getattr(import_module(home.partition(":")[0]), home.partition(":")[2]) for home in self.homes]

    def known(self) -> list[str]:
        """Return all names, in order."""
        every = (*(name for registry in self.registries for name in registry), *self.others)
        return [name for name in every if name not in self.without]

    def name(self, option: str, written: str) -> str:
        """Return the known name that `written` spells in any way; if other values are allowed, return `written`
        unchanged.

        Raises:
            InputError: The name is unknown; the message lists the names.
        """
        if self.beside is not None:
            return written
        if as_named(written, self.known()) not in self.known():
            for registry in self.registries:
                if isinstance(registry, Registry):
                    registry.add_installed()
        own, known = as_named(written, self.known()), self.known()
        if own not in known:
            raise InputError(option, written, ", ".join(known))
        return own


def names_of(kind: Any) -> Names | None:
    """Return the `Names` annotation within a type, at any depth, or None."""
    found = next((x for x in getattr(kind, "__metadata__", ()) if isinstance(x, Names)), None)
    return found or next((inner for part in get_args(kind) if (inner := names_of(part))), None)


@dataclass(frozen=True)
class Condition:
    """Condition under which an option has an effect.

    Args:
        words: The condition as text, such as `only with --space hand`.
        holds: Function that returns whether the options of a command meet the condition.
    """

    words: str
    holds: Callable[[Any], bool]


Conditions: TypeAlias = Mapping[str, Condition | tuple[Condition, ...]]  # of options, by the names of their fields


def when(option: str, *values: object, why: str = "", of: str = "") -> Condition:
    """Return the condition that an option has one of these values or, if none are given, that it is not at its default.

    Args:
        option: Name of its field.
        values: Allowed values.
        why: Text after the values in `Condition.words`, the reason of the condition.
        of: Attribute that has the value; default: the field.
    """
    words = f"only with {' '.join([flag(option), ' or '.join(map(str, values))]).rstrip()}{why}"
    return Condition(words, lambda options: _is(options, option, values, of))


def unless(option: str, *values: object, why: str = "", of: str = "") -> Condition:
    """Return the condition that an option has none of these values or, if none are given, that it is at its default.

    The arguments are those of `when`.
    """
    words = f"only without {' '.join([flag(option), ' or '.join(map(str, values))]).rstrip()}{why}"
    return Condition(words, lambda options: not _is(options, option, values, of))


def _is(options: OptionGroup, option: str, values: tuple, of: str) -> bool:
    return getattr(options, of or option) in values if values else options.given(option)


@dataclass(frozen=True)
class Interval:
    """Range of an option's value. If the option has several values, it applies to each; None is not checked.

    Args:
        low, high: Least and largest value.
        strict: Whether the value has to be above `low`.
    """

    low: float = -math.inf
    high: float = 1e15  # as `whiptool.models.numbers.LARGEST`, without its import
    strict: bool = False

    def check(self, name: str, value: Any) -> None:
        """Refuse a number beyond the range, or that is not finite.

        Raises:
            InputError: The number is beyond the range or not finite; the message names the option `name`.
        """
        from whiptool.models.numbers import number

        number(name, value, low=self.low, high=self.high, strict=self.strict)


@dataclass(frozen=True)
class Count(Interval):
    """Range of an option whose value is a whole number."""

    low: int = 1
    high: int = MANY

    def check(self, name: str, value: Any) -> None:
        """Refuse a number beyond the range, as `Interval.check` does."""
        whole(name, value, low=self.low, high=self.high)


Ranges: TypeAlias = Mapping[str, Interval]  # of options, by the names of their fields


@dataclass(frozen=True, kw_only=True)
class OptionGroup:
    """Base of groups of command-line options, such as `TargetOptions`, of which commands are composed.

    A group may list some of its fields in class variables, which a command collects from all its groups:
    `of_this_call`, not stored with a run; `changeable`, may be given again when a run is resumed; `may_be_empty`,
    options with several values that may be given without any; `first`, shown by `--help` of a command with many
    options. `heading` is the group's heading in the help. `only_with` has the conditions under which options have an
    effect: help leaves out options without effect, and giving one is refused. `ranges` has the allowed values.
    """

    of_this_call: ClassVar[tuple[str, ...]] = ()
    changeable: ClassVar[tuple[str, ...]] = ()
    may_be_empty: ClassVar[tuple[str, ...]] = ()
    first: ClassVar[tuple[str, ...]] = ()
    heading: ClassVar[str] = "options"
    only_with: ClassVar[Conditions] = {}
    ranges: ClassVar[Ranges] = {}

    def check(self) -> None:
        """Refuse values that are out of range, and options that have no effect with the others.

        Raises:
            InputError: A value is out of range, or an option has no effect; the option is named.
        """
        for f in fields(self):
            if self.given(f.name) and (broken := self.broken_condition(f.name)):
                self.refuse_given(broken.words, f.name)
        for group in type(self).__mro__:
            for name, allowed in group.__dict__.get("ranges", {}).items():
                value = getattr(self, name)
                for each in value if isinstance(value, tuple) else (value,):
                    if each is not None:
                        allowed.check(flag(name), each)

    def refuse_given(self, words: str, *names: str) -> None:
        """Refuse options that have no effect.

        Args:
            words: Condition under which the options are allowed, for the message.
            names: Names of the options' fields.

        Raises:
            InputError: One of them is given.
        """
        for name in names:
            if self.given(name):
                value = getattr(self, name)
                raise InputError(flag(name), str(value) if isinstance(value, Path) else value, words)

    def given(self, name: str) -> bool:
        """Return whether an option's value differs from its default."""
        return getattr(self, name) != self.usual(name)

    def usual(self, name: str) -> object:
        """Return the default of an option."""
        return next(f.default for f in fields(self) if f.name == name)

    def broken_condition(self, name: str) -> Condition | None:
        """Return the condition under which an option would have an effect; None if it has one."""
        for group in type(self).__mro__:
            found = group.__dict__.get("only_with", {}).get(name, ())
            for condition in (found,) if isinstance(found, Condition) else found:
                if not condition.holds(self):
                    return condition
        return None

    def needs(self) -> tuple[str, ...]:
        """Return the optional modules that the command imports with these options, so that missing ones are reported
        first.
        """
        return ()

    @classmethod
    def named(cls, which: str) -> set[str]:
        """Return the fields that all groups list in a class variable, such as `changeable`."""
        return {name for group in cls.__mro__ for name in group.__dict__.get(which, ())}

    def kept(self) -> Self:
        """Return the options to store with a run: those in `of_this_call` are reset to their defaults."""
        passing = self.named("of_this_call")
        return replace(self, **{f.name: f.default for f in fields(self) if f.name in passing})


@dataclass(frozen=True, kw_only=True)
class SeedOptions(OptionGroup):
    """Option for the seed of all random numbers."""

    heading: ClassVar[str] = "search"
    first: ClassVar[tuple[str, ...]] = ("seed",)
    ranges: ClassVar[Ranges] = {"seed": Count(0)}

    seed: int = 0
    """Seed of all random numbers (default: 0)."""


@dataclass(frozen=True, kw_only=True)
class JsonOptions(OptionGroup):
    """Options for the format of the printed result."""

    of_this_call: ClassVar[tuple[str, ...]] = ("json", "quiet")
    heading: ClassVar[str] = "result"
    first: ClassVar[tuple[str, ...]] = ("json", "quiet")

    json: bool = False
    """Print one JSON object on stdout and nothing else there."""
    quiet: bool = False
    """Show no progress on stderr; warnings and errors are still shown."""

    def tell(self, summary: Mapping[str, Any], text: str) -> None:
        """Print a result: one JSON object, or lines of text."""
        print(dumps(summary, allow_nan=False) if self.json else text, flush=True)


@dataclass(frozen=True, kw_only=True)
class OutputOptions(JsonOptions):
    """Option for the run folder."""

    of_this_call: ClassVar[tuple[str, ...]] = ("out",)
    first: ClassVar[tuple[str, ...]] = ("out",)

    out: Path | None = None
    """Run folder (default: a new folder in runs/). The new folder is named after the command or method, the date and
    the time."""


@dataclass(frozen=True, kw_only=True)
class ResumableOptions(OutputOptions):
    """Options for the run folder of a run that can be resumed."""

    of_this_call: ClassVar[tuple[str, ...]] = ("resume",)
    first: ClassVar[tuple[str, ...]] = ("resume",)

    resume: Path | None = None
    """Resume the run in this folder, without giving its options again. Those that are given have to be the run's, but
    for a few, such as --video of optimize or --episodes of train."""


def whole(name: str, value: int, *, low: int = 1, high: int = MANY) -> int:
    """Return a whole number after checking its range.

    Raises:
        InputError: The number is out of range.
    """
    if not low <= value <= high:
        raise InputError(name, value, f"a whole number from {low} to {high}")
    return value


def check_place(name: str, path: Path, *, ending: str = "") -> None:
    """Refuse a file that could not be written, or whose name ends otherwise, before anything is computed for it.

    Raises:
        InputError: The path is a folder, its name has another ending, or its parent folder does not exist or is not
            writable.
    """
    folder = path.parent
    if not path.name.endswith(ending):
        raise InputError(name, str(path), f"a file whose name ends in {ending}")
    try:
        is_folder = path.is_dir()
    except OSError as error:  # its name is too long
        raise InputError(name, str(path), "a file that can be written", f"reason: {error.strerror}") from None
    if is_folder:
        raise InputError(name, str(path), "a file that can be written, not a folder")
    if not folder.is_dir():
        raise InputError(name, str(path), f"a file that can be written ({folder} is not an existing folder)")
    if not os.access(path if path.exists() else folder, os.W_OK):
        raise InputError(name, str(path), "a file that can be written (permission denied)")


def flag(name: str) -> str:
    """Return the command-line flag of a field: `--t-stay` for `t_stay`."""
    return "--" + name.replace("_", "-")


def flags(options: OptionGroup) -> Iterator[tuple[str, str]]:
    """Yield the name of each field that is given by a flag, and the flag."""
    for f in fields(options):
        if "Positional" not in str(f.type):
            yield f.name, flag(f.name)


_OF_MODEL = "--whip-length and --mount"
_OPTIONS = {  # by the library's names, where these differ
    "whip_and_mount": _OF_MODEL,
    "bounds": "--lower and --upper",
    "largest_speed": "--most-speed",
    "normal_of_the_box": "--box-normal",
    "velocity_of_the_box": "--box-velocity",
    "drag_per_mass_of_the_thing": "--thing-mass and --thing-diameter",
}


@contextmanager
def options_named(options: OptionGroup, **others: str) -> Iterator[None]:
    """Rename, in an InputError raised within the `with` block, the library's argument to the command's option.

    Args:
        options: Options of the command: the library's `t_stay` or `t stay` becomes `--t-stay`.
        others: Options whose names differ, by the library's names.

    Raises:
        InputError: The error that was raised in the block, with the option's name.
    """
    free = getattr(options, "keep_free", 0.0)
    try:
        with renaming({**_OPTIONS, **dict(flags(options)), **others}):
            yield
    except InputError as error:
        if free and error.name == _OF_MODEL:
            error = error.renamed(f"--keep-free, {_OF_MODEL}")
            error = error.advising(f"joints move within {1 - free:.2g} of their ranges: give a smaller --keep-free")
        raise of_run(error, getattr(options, "resume", None)) from None


def of_run(error: InputError, resume: Path | None) -> InputError:
    """Return the error of an option, or of `--resume` if another version began the run with that option."""
    from whiptool.runs import begun_by, read_config

    if resume is None or not error.name.startswith("--") or error.name == "--resume":
        return error
    version = begun_by(read_config(resume))
    rule = f"a run whose options this version takes ({error})"
    return InputError("--resume", str(resume), rule, f"begin a new run; this one began{version}") if version else error


@contextmanager
def renaming(names: Mapping[str, str], fix: str = "") -> Iterator[None]:
    """Rename the value that an InputError raised in a `with` block names, and add a fix to the error.

    Args:
        names: New names, by the old names with underscores instead of spaces; other values are not renamed. Of `x[2]`,
            the third number of `x`, the name is that of `x`.
        fix: Text on how to correct the error.
    """
    try:
        yield
    except InputError as error:
        old, _, index = error.name.replace(" ", "_").partition("[")
        name = names.get(old)
        if name is None:
            raise
        number = index.removesuffix("]")
        place = f", number {int(number) + 1}" if number.isdecimal() else index and f"[{index}"
        raise error.renamed(name + place, fix) from None
