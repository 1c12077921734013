"""A report's page is whole and escapes what it shows."""

from __future__ import annotations

import re

import pytest
from matplotlib.figure import Figure

from whiptool.viz import report
from whiptool.viz.report import Claim, Claims, Picture, Section, Table, Text, to_html

pytestmark = pytest.mark.slow


def test_the_page_is_whole_and_escapes_what_it_shows():
    figure = Figure()
    figure.subplots().plot([0, 1])
    claim = Claim("a < b", "1 %", "2 %", report.NOT_REPRODUCED, "2 > 1")
    parts = [Text("<b>"), Table([["a", "b"], ["x", "&"]], "c"), Picture(figure, "line"), Claims([claim])]
    page = to_html("title", "sub", {"code": "1"}, [Section("one", parts)])
    assert page == to_html("title", "sub", {"code": "1"}, [Section("one", parts)])
    assert "&lt;b&gt;" in page
    assert "a &lt; b" in page
    assert "1 claims: 1 not reproduced." in page
    assert not re.search(r"""(src|href)=["'](?!data:|#)""", page)
