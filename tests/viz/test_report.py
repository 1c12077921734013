"""A report's page is whole and escapes what it shows."""

from __future__ import annotations

import json
import re
from types import SimpleNamespace

import jinja2
import pytest
from browser_pages import browser, chromium, count, picture, root_data
from matplotlib.figure import Figure

from whiptool.viz import report
from whiptool.viz.report import (
    Claim,
    Claims,
    Picture,
    Section,
    Table,
    Text,
    _environment,
    filled,
    to_html,
    without_verdicts,
)


def test_the_page_is_whole_and_escapes_what_it_shows():
    figure = Figure()
    figure.subplots().plot([0, 1])
    claim = Claim("a < b", "1 %", "2 %", report.NOT_REPRODUCED, "2 > 1")
    parts = [Text("<b> `<c>`"), Table([["a", "b"], ["x", "&"]], "c"), Picture(figure, "line"), Claims([claim])]
    page = to_html("title", "sub", {"code": "1"}, [Section("one", parts)])
    assert page == to_html("title", "sub", {"code": "1"}, [Section("one", parts)])
    assert "&lt;b&gt; <code>&lt;c&gt;</code>" in page
    assert "a &lt; b" in page
    assert "1 claim: 1 not reproduced." in page
    assert not re.search(r"""(src|href)=["'](?!data:|#)""", page)


def test_a_quick_form_gives_no_verdicts():
    """Neither on a claim nor in a table of goals; what was measured stays."""
    claims = Claims([Claim("a", "1 %", "2 %", report.NOT_REPRODUCED, "2 > 1")])
    goals = Table([["", "goal", "seen", "met"], ["a", "<= 1", "2", "no"]], judges=True)
    plain = Table([["x", "y"], ["1", "2"]])
    (section,) = without_verdicts([Section("one", [claims, goals, plain])], "too short")
    (claim,) = section.claims
    assert (claim.verdict, claim.reason, claim.ours) == ("no verdict", "too short", "2 %")
    assert section.parts[1].rows == [["", "goal", "seen"], ["a", "<= 1", "2"]]
    assert section.parts[1].caption == "No verdicts: too short."
    assert section.parts[2] is plain
    page = to_html("title", "sub", {}, [section])
    assert "1 claim: 1 without a verdict." in page
    assert "reproduced" not in re.sub(r"<style>.*?</style>", "", page, flags=re.S)


@pytest.fixture(scope="module")
def broad_page():
    """A table of nine columns, claims with long words, and a broad picture."""
    figure = Figure((11, 3))
    figure.subplots().plot([0, 1])
    header, row = [f"a long head {i}" for i in range(9)], [f"{i}.123 to {i}.456" for i in range(9)]
    claim = Claim("a claim of some length", "its number", "ours; " * 20, report.REPRODUCED, "why " * 20)
    parts = [Table([header, row], "caption"), Claims([claim]), Picture(figure, "line")]
    return to_html("title", "sub", {"fact": "x" * 60 + " " + "y" * 60}, [Section("one", parts)])


def test_a_table_without_a_head_has_no_empty_row():
    page = to_html("title", "sub", {}, [Section("one", [Table([["", ""], ["verdict", "hit"]])])])
    assert "<tr class=head>" not in page
    assert "<th>verdict</th>" in page
    assert '<th data-of="strike">1</th>' in to_html(
        "t", "s", {}, [Section("one", [Table([["strike", "x"], ["1", "2"]])])]
    )


@pytest.mark.slow
@browser
def test_no_table_is_wider_than_a_telephone(broad_page, tmp_path):
    """At 390 pixels nothing reaches beyond the page but the picture, which is moved sideways in its frame."""
    probe = """<script>
    document.querySelector("details").open = true;
    const root = document.documentElement, cell = document.querySelector("td[data-of]");
    const wide = (x) => x.getBoundingClientRect().right > innerWidth + 0.5;
    const all = [...document.querySelectorAll("table, td, th, p, figure")];
    const label = getComputedStyle(cell, "::before").content;
    Object.assign(root.dataset, { width: innerWidth, wide: all.filter(wide).length, label });
    root.dataset.scrolls = root.scrollWidth > innerWidth;
    </script>"""
    inner = tmp_path / "inner.html"
    inner.write_text(broad_page.replace("</body>", probe + "</body>"), encoding="utf-8")
    frame = f"""<!doctype html><html><body><iframe id=f width=390 height=900 src="{inner.as_uri()}"></iframe><script>
    f.onload = () => Object.assign(document.documentElement.dataset, f.contentDocument.documentElement.dataset);
    </script></body></html>"""  # chromium's own windows are broader
    found = root_data(chromium(tmp_path, frame, "--allow-file-access-from-files", "--dump-dom"))
    assert found["data-width"] == "390"
    assert (found["data-wide"], found["data-scrolls"]) == ("0", "false")
    assert "a long head 1" in found["data-label"]


@pytest.mark.slow
@browser
def test_the_page_is_dark_where_the_reader_wants_it(broad_page, tmp_path):
    light = picture(tmp_path, broad_page, "light", size="500,900")
    dark = picture(tmp_path, broad_page, "dark", "--blink-settings=preferredColorScheme=0", size="500,900")
    assert dark.mean() < 0.3 < 0.7 < light.mean()
    assert count(dark, "#15181c") > 1e5  # as the page of a strike


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
