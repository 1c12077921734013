"""Errors that a user can act on: what was given, what is allowed, and the fix, in one line."""

from __future__ import annotations


class WhiptoolError(Exception):
    """Base class of every error that whiptool raises on purpose."""


class _Nothing:
    """What was given where nothing was."""

    def __repr__(self) -> str:
        return "nothing"


NOTHING = _Nothing()


class InputError(WhiptoolError, ValueError):
    """A value from outside that breaks a rule.

    Args:
        name: What the value is called where the user wrote it (option, key, argument).
        given: The value as given.
        allowed: The rule that it breaks.
        fix: What to do about it, if the rule does not say it already.
    """

    def __init__(self, name: str, given: object, allowed: str, fix: str = "") -> None:
        self.name, self.given, self.allowed, self.fix = name, given, allowed, fix
        message = f"{name}: got {given!r}; allowed: {allowed}" + (f"; {fix}" if fix else "")
        super().__init__(" ".join(message.split()))  # always one line

    def within(self, place: str) -> InputError:
        """The same error, its name prefixed with where it stands (`whip.` or `model.toml: `)."""
        return self.renamed(place + self.name)

    def renamed(self, name: str, fix: str = "") -> InputError:
        """The same error under the name that the value has where it was written, and with a fix if it has none."""
        return InputError(name, self.given, self.allowed, self.fix or fix)
