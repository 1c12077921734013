"""Questions to a person before an arm moves."""

from __future__ import annotations

import os
import sys
from types import SimpleNamespace

import pytest

from whiptool.commands.options.rig_options import says_yes


@pytest.mark.parametrize(("before", "after", "agreed"), [("yes\n", "no\n", False), ("no\n", "yes\n", True)])
def test_what_was_typed_before_a_question_does_not_answer_it(before, after, agreed, monkeypatch):
    """A person types at a terminal before and after the question stands there."""
    hands, terminal = os.openpty()
    os.write(hands, before.encode())

    def shown(text: str) -> None:
        if text.startswith("Is everybody away?"):
            os.write(hands, after.encode())

    with open(terminal) as typed:  # noqa: PTH123  # a file descriptor
        monkeypatch.setattr(sys, "stdin", typed)
        monkeypatch.setattr(sys, "stderr", SimpleNamespace(write=shown, flush=lambda: None))
        assert says_yes("Is everybody away? ") is agreed
    os.close(hands)
