"""A report as one self-contained HTML file: sections of text, tables, figures and claims."""

from __future__ import annotations

import base64
import io
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Any, ClassVar

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape
from matplotlib.figure import Figure

from whiptool.words import counted

REPRODUCED, NOT_REPRODUCED, ONLY_WITH = "reproduced", "not reproduced", "reproduced only with"
NO_VERDICT = "no verdict"
_STYLE = {REPRODUCED: "yes", NOT_REPRODUCED: "no", ONLY_WITH: "partly", NO_VERDICT: "none"}  # names in report.css
_BROAD = 6.5  # [in]; the text of a wider picture is too small to read on a telephone


@dataclass(frozen=True)
class Text:
    """Paragraph of plain text in a report."""

    template: ClassVar[str] = "text.html"
    text: str


@dataclass(frozen=True)
class Table:
    """Table of a report: rows of cells, the first of which is the header; if `judges`, the last column is a verdict."""

    template: ClassVar[str] = "table.html"
    rows: Sequence[Sequence[str]]
    caption: str = ""
    judges: bool = False


@dataclass(frozen=True, eq=False)
class Picture:
    """A matplotlib figure in a report: as SVG, or as PNG if `vector` is false, which suits figures with very many
    elements.
    """

    template: ClassVar[str] = "picture.html"
    figure: Figure
    caption: str
    vector: bool = True

    @property
    def broad(self) -> bool:
        """Whether the figure is so wide that its text would be too small on a telephone."""
        return bool(self.figure.get_figwidth() > _BROAD)

    @cached_property
    def source(self) -> str:
        """The picture as a data URL; drawn once for each figure."""
        kind, data = _image(self)
        return f"data:image/{kind};base64,{base64.b64encode(data).decode()}"


@dataclass(frozen=True)
class Claim:
    """A claim of a paper, and the measurement that tests it.

    Args:
        claim: Text of the claim.
        paper: Value in the paper, or the section where it is.
        ours: Our measurement, with numbers.
        verdict: Verdict, which begins with one of `REPRODUCED`, `NOT_REPRODUCED`, `ONLY_WITH`, `NO_VERDICT`.
        reason: Measurement that decides the verdict.
    """

    claim: str
    paper: str
    ours: str
    verdict: str
    reason: str

    @property
    def kind(self) -> str:
        """The one of `REPRODUCED`, `NOT_REPRODUCED`, `ONLY_WITH` and `NO_VERDICT` with which the verdict begins."""
        return next(name for name in (ONLY_WITH, *_STYLE) if self.verdict.startswith(name))

    @property
    def style(self) -> str:
        """Return the name of the verdict's colour in `report.css`."""
        return _STYLE[self.kind]


@dataclass(frozen=True)
class Claims:
    """A list of claims, as a part of a report."""

    template: ClassVar[str] = "claims.html"
    claims: Sequence[Claim]


@dataclass(frozen=True)
class Section:
    """A part of a report, with a heading."""

    title: str
    parts: Sequence[Text | Table | Picture | Claims]

    @property
    def claims(self) -> list[Claim]:
        """The claims of all parts of the section that are `Claims`, in order."""
        return [claim for part in self.parts if isinstance(part, Claims) for claim in part.claims]


def verdict_over(holds: Mapping[str, bool]) -> str:
    """Return the verdict on a claim tested in several ways: reproduced in all, in none, or only in some."""
    kept = [name for name, held in holds.items() if held]
    if len(kept) == len(holds):
        return REPRODUCED
    return f"{ONLY_WITH} {' or '.join(kept)}" if kept else NOT_REPRODUCED


def without_verdicts(sections: Sequence[Section], why: str) -> list[Section]:
    """Return the sections with the reason `why` instead of any verdict, for quick runs that are too short for one."""

    def open_to(part: Text | Table | Picture | Claims) -> Text | Table | Picture | Claims:
        if isinstance(part, Table) and part.judges:
            return Table([row[:-1] for row in part.rows], f"{part.caption} No verdicts: {why}.".strip())
        if not isinstance(part, Claims):
            return part
        return Claims([replace(claim, verdict=NO_VERDICT, reason=why) for claim in part.claims])

    return [Section(section.title, [open_to(part) for part in section.parts]) for section in sections]


def to_html(title: str, subtitle: str, facts: Mapping[str, str], sections: Sequence[Section]) -> str:
    """Return the report as one HTML page.

    Args:
        title: Title of the page.
        subtitle: Line below the title.
        facts: Facts about the run, by name.
        sections: Sections in order; their claims are summarised at the top.
    """
    claims = [claim for section in sections for claim in section.claims]
    count = _count(claims) if claims else ""
    return filled("report.html", title=title, subtitle=subtitle, facts=facts, sections=sections, count=count)


def _count(claims: Sequence[Claim]) -> str:
    words = {REPRODUCED: REPRODUCED, ONLY_WITH: f"{ONLY_WITH} a change", NOT_REPRODUCED: NOT_REPRODUCED}
    words |= {NO_VERDICT: "without a verdict"}
    counts = {kind: sum(claim.kind == kind for claim in claims) for kind in words}
    said = [f"{count} {words[kind]}" for kind, count in counts.items() if count]
    return f"{counted(len(claims), 'claim')}: {', '.join(said)}."


def _image(picture: Picture) -> tuple[str, bytes]:
    """Its kind, and the file; the same bytes for the same figure."""
    import matplotlib

    data = io.BytesIO()
    if picture.vector:
        with matplotlib.rc_context({"svg.hashsalt": "whiptool", "svg.fonttype": "path"}):
            picture.figure.savefig(data, format="svg", bbox_inches="tight", metadata={"Date": None})
        return "svg+xml", data.getvalue()
    picture.figure.savefig(data, format="png", dpi=160, bbox_inches="tight")
    return "png", data.getvalue()


def filled(template: str, **values: Any) -> str:
    """Return the text of a Jinja template of the folder `templates` with these values, escaped as HTML."""
    return _environment().get_template(template).render(values)


def _with_code(text: str) -> Markup:
    """Return a text as HTML, in which what stands between backticks is code."""
    return Markup(re.sub("`([^`]+)`", r"<code>\1</code>", str(escape(text))))


@cache
def _environment() -> Environment:
    environment = Environment(
        loader=PackageLoader("whiptool.viz"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters["code"] = _with_code
    environment.policies["json.dumps_kwargs"] = {"allow_nan": False, "separators": (",", ":")}
    return environment
