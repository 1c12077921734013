"""An error is one line of bounded length, whatever was given."""

from __future__ import annotations

import pytest

from whiptool.errors import InputError, alike


def nested(depth: int) -> list:
    inner: list = []
    for _ in range(depth):
        inner = [inner]
    return inner


GIVEN = {
    "10^400": 10**400,
    "10^5000": 10**5000,
    "text": "x" * 10_000,
    "lists in lists": nested(100_000),
    "a list": [0] * 9999,
}


@pytest.mark.parametrize("given", GIVEN.values(), ids=GIVEN)
def test_what_was_given_is_shown_in_a_line(given: object) -> None:
    error = InputError("k" * 10_000, given, "a number").within("file: ")
    assert len(str(error)) < 1000
    assert "\n" not in str(error)
    assert str(error).endswith("; allowed: a number")
    assert error.given is given


@pytest.mark.parametrize(
    ("given", "asked"),
    [("directtl", "directl"), ("CMEAS", "cmaes"), ("directl", ""), ("zzz", ""), (3, ""), ("or", "")],
)
def test_what_is_like_an_allowed_word_is_asked_for(given, asked):
    said = str(InputError("method", given, "directl, cmaes, or the name of a file"))
    assert said.endswith(f"; did you mean {asked}?" if asked else "of a file")


def test_a_word_of_a_sentence_is_not_asked_for():
    """No method is called maps."""
    said = str(InputError("method", "map", "any other method, because maps are of strikes and not of throws"))
    assert said.endswith("of strikes and not of throws")


def test_a_misspelling_begins_with_the_same_letter():
    names = ["cone", "zone-radius", "ur5e"]
    misspelt = {"zone": "", "conne": "cone", "zone-radiu": "zone-radius", "ur5": "ur5e", "": ""}
    assert {given: alike(given, names) for given in misspelt} == misspelt
