"""Templates: what is filled in is escaped, and nothing may be missing."""

from __future__ import annotations

import json
import re
from types import SimpleNamespace

import jinja2
import pytest

from whiptool.viz.templating import _environment, filled


@pytest.fixture
def text():
    """Fills a template that is given as text."""
    return lambda source, **values: _environment().from_string(source).render(values)


def test_what_is_filled_in_is_escaped():
    page = filled("text.html", part=SimpleNamespace(text='<b>&"'))
    assert page == "<p>&lt;b&gt;&amp;&#34;</p>\n"


def test_what_is_missing_is_an_error():
    with pytest.raises(jinja2.UndefinedError, match="'part' is undefined"):
        filled("text.html")
    with pytest.raises(jinja2.UndefinedError, match="no attribute 'text'"):
        filled("text.html", part=SimpleNamespace())
    with pytest.raises(jinja2.TemplateNotFound):
        filled("nowhere.html")


def test_numbers_in_scripts_are_short_json(text):
    page = text("<script>{{ x | tojson }}</script>", x={"a": [1.5, 2], "b": "</script>"})
    inside = re.fullmatch(r"<script>(.*)</script>", page)
    assert inside
    assert "</script>" not in inside[1]
    assert " " not in inside[1]
    assert json.loads(inside[1]) == {"a": [1.5, 2], "b": "</script>"}


def test_not_a_number_is_no_json(text):
    """A browser's JSON has none."""
    with pytest.raises(ValueError, match="not JSON compliant"):
        text("{{ x | tojson }}", x=float("nan"))


def test_statements_leave_no_blank_lines(text):
    assert text("a\n  {% if yes %}\nb\n  {% endif %}\nc\n", yes=True) == "a\nb\nc\n"
