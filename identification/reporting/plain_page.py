"""Writes a self-contained HTML page without scripts: heading, sections, tables and figures."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

_STYLE = (
    ":root{color-scheme:light dark}"
    "body{font:15px/1.5 system-ui,sans-serif;max-width:68rem;margin:2rem auto;padding:0 1rem}"
    "h1{font-size:1.5rem}h2{font-size:1.15rem;margin:2rem 0 .5rem}"
    "table{border-collapse:collapse}td,th{padding:.25rem .8rem .25rem 0;text-align:left;vertical-align:top;"
    "border-bottom:1px solid color-mix(in srgb,currentColor 25%,transparent)}"
    "svg{max-width:100%;height:auto}figure{margin:0 0 1.5rem}figcaption{font-weight:600}"
    "figure p{margin:.1rem 0;font-size:.9rem}.figures{display:flex;flex-wrap:wrap;gap:1.5rem}"
    ".scrolls{overflow-x:auto}"
)


def page(title: str, parts: Sequence[str]) -> str:
    """The HTML of the whole page.

    Args:
        title: Heading, not yet escaped.
        parts: HTML below the heading.
    """
    head = (
        '<meta charset="utf-8"><meta name="generator" content="phantom-dyn">'
        f'<meta name="viewport" content="width=device-width"><title>{escape(title)}</title>'
    )
    body = "\n".join([f"<h1>{escape(title)}</h1>", *parts])
    return f'<!doctype html><html lang="en"><head>{head}<style>{_STYLE}</style></head><body>\n{body}\n</body></html>\n'


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """The HTML of a table.

    Args:
        head: Names of the columns, not yet escaped.
        rows: Texts of the cells of each row, not yet escaped.
    """
    lines = ["<tr>" + "".join(f"<th>{escape(word)}</th>" for word in head) + "</tr>"]
    lines += ["<tr>" + "".join(f"<td>{escape(word)}</td>" for word in row) + "</tr>" for row in rows]
    return f'<div class="scrolls"><table>{"".join(lines)}</table></div>'


def html_list(sentences: Sequence[str]) -> str:
    """The HTML of a list of sentences, which are not yet escaped."""
    return "<ul>" + "".join(f"<li>{escape(sentence)}</li>" for sentence in sentences) + "</ul>"


def figure(caption: str, svg: str, notes: Sequence[str] = ()) -> str:
    """The HTML of a figure, with its caption above and sentences below.

    Args:
        caption: Caption, not yet escaped; empty for none.
        svg: The SVG element.
        notes: Sentences, not yet escaped.
    """
    below = "".join(f"<p>{escape(note)}</p>" for note in notes)
    above = f"<figcaption>{escape(caption)}</figcaption>" if caption else ""
    return f"<figure>{above}{svg}{below}</figure>"
