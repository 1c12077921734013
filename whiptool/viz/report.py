"""A report as one HTML file that needs nothing else: sections of text, tables, figures and claims."""

from __future__ import annotations

import base64
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape

from matplotlib.figure import Figure

REPRODUCED, NOT_REPRODUCED, ONLY_WITH = "reproduced", "not reproduced", "reproduced only with"


@dataclass(frozen=True)
class Text:
    """Paragraph of plain text in a report."""

    text: str


@dataclass(frozen=True)
class Table:
    """Rows of cells, the first being the header."""

    rows: Sequence[Sequence[str]]
    caption: str = ""


@dataclass(frozen=True, eq=False)
class Picture:
    """A matplotlib figure, as vectors unless it has too many of them."""

    figure: Figure
    caption: str
    vector: bool = True


@dataclass(frozen=True)
class Claim:
    """What a paper says, and what was measured.

    Args:
        claim: In words.
        paper: Its number or where it stands.
        ours: What was measured, with numbers.
        verdict: Begins with one of `REPRODUCED`, `NOT_REPRODUCED`, `ONLY_WITH`.
        reason: What was measured that decides it.
    """

    claim: str
    paper: str
    ours: str
    verdict: str
    reason: str


@dataclass(frozen=True)
class Claims:
    """Claims, one below the other."""

    claims: Sequence[Claim]


@dataclass(frozen=True)
class Section:
    """A part of a report, with a heading."""

    title: str
    parts: Sequence[Text | Table | Picture | Claims]

    @property
    def claims(self) -> list[Claim]:
        """Return all claims of the report, in order."""
        return [claim for part in self.parts if isinstance(part, Claims) for claim in part.claims]


def verdict_over(holds: Mapping[str, bool]) -> str:
    """The verdict on a claim that was tried in several ways: in all, in none, or only with some of them."""
    kept = [name for name, held in holds.items() if held]
    if len(kept) == len(holds):
        return REPRODUCED
    return f"{ONLY_WITH} {' or '.join(kept)}" if kept else NOT_REPRODUCED


def to_html(title: str, subtitle: str, facts: Mapping[str, str], sections: Sequence[Section]) -> str:
    """The report.

    Args:
        title: Of the page.
        subtitle: A line below.
        facts: What was run, by name.
        sections: In order; their claims are summed up at the top.
    """
    claims = [claim for section in sections for claim in section.claims]
    contents = "".join(f'<li><a href="#s{i}">{escape(s.title)}</a></li>' for i, s in enumerate(sections))
    body = [
        f"<h1>{escape(title)}</h1><p class=sub>{escape(subtitle)}</p>",
        f"<nav><ol>{contents}</ol></nav>",
        f"<p>{_count(claims)}</p>" if claims else "",
        "<details><summary>What was run</summary><table>",
        *(f"<tr><th>{escape(name)}</th><td class=left>{escape(text)}</td></tr>" for name, text in facts.items()),
        "</table></details>",
    ]
    for i, section in enumerate(sections):
        body.append(f'<section id="s{i}"><h2>{escape(section.title)}</h2>')
        body += [_part(part) for part in section.parts]
        body.append("</section>")
    return (
        f"<!doctype html>\n<html lang=en><head><meta charset=utf-8><title>{escape(title)}</title>"
        f'<meta name=viewport content="width=device-width, initial-scale=1"><style>{_STYLE}</style></head>\n<body>'
        + "\n".join(body)
        + "</body></html>\n"
    )


def _count(claims: Sequence[Claim]) -> str:
    counts = {name: sum(_kind(c) == name for c in claims) for name in (REPRODUCED, ONLY_WITH, NOT_REPRODUCED)}
    said = [f"{number} {name}{' a change' if name == ONLY_WITH else ''}" for name, number in counts.items() if number]
    return f"{len(claims)} claims: {', '.join(said)}."


def _kind(claim: Claim) -> str:
    return next(name for name in (ONLY_WITH, NOT_REPRODUCED, REPRODUCED) if claim.verdict.startswith(name))


def _part(part: Text | Table | Picture | Claims) -> str:
    if isinstance(part, Text):
        return f"<p>{escape(part.text)}</p>"
    if isinstance(part, Table):
        head, *rows = part.rows
        lines = ["".join(f"<th>{escape(c)}</th>" for c in head)]
        lines += [f"<th>{escape(row[0])}</th>" + "".join(f"<td>{escape(c)}</td>" for c in row[1:]) for row in rows]
        caption = f"<caption>{escape(part.caption)}</caption>" if part.caption else ""
        return f"<div class=wide><table>{caption}{''.join(f'<tr>{line}</tr>' for line in lines)}</table></div>"
    if isinstance(part, Picture):
        kind, data = _image(part)
        source = f"data:image/{kind};base64,{base64.b64encode(data).decode()}"
        caption = escape(part.caption)
        return f'<figure><img alt="{caption}" src="{source}"><figcaption>{caption}</figcaption></figure>'
    head = "".join(f"<th>{name}</th>" for name in ("claim", "paper", "here", "verdict"))
    rows = "".join(
        f"<tr><td class=left>{escape(c.claim)}</td><td class=left>{escape(c.paper)}</td>"
        f"<td class=left>{escape(c.ours)}</td>"
        f"<td class=left><b class={_CLASS[_kind(c)]}>{escape(c.verdict)}</b><br>{escape(c.reason)}</td></tr>"
        for c in part.claims
    )
    return f"<div class=wide><table class=claims><tr>{head}</tr>{rows}</table></div>"


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


_CLASS = {REPRODUCED: "yes", NOT_REPRODUCED: "no", ONLY_WITH: "partly"}
_STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; max-width: 66rem; margin: 2rem auto; padding: 0 1rem; color: #222 }
h1 { margin-bottom: 0 } h2 { margin-top: 3rem; border-bottom: 2px solid #0072B2 } .sub { color: #555 }
table { border-collapse: collapse; margin: 1rem 0; font-size: 0.92rem }
caption { text-align: left; color: #555; padding-bottom: .3rem }
th, td { padding: .25rem .7rem; border-bottom: 1px solid #ddd; text-align: right; vertical-align: top }
th:first-child, .left, .claims th { text-align: left } .wide { overflow-x: auto }
.claims { width: 100% } .yes { color: #00714f } .no { color: #b34700 } .partly { color: #0072B2 }
figure { margin: 1.5rem 0 } img { max-width: 100%; height: auto } figcaption { color: #555; font-size: .92rem }
@media print { section { break-inside: avoid-page } }
"""
