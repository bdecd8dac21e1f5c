"""Pieces of a self-contained HTML page."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

STYLE = """
:root{color-scheme:light}
body{font:15px/1.55 system-ui,"Segoe UI","DejaVu Sans",sans-serif;color:#20242b;background:#f5f6f8;margin:0}
main{max-width:1260px;margin:0 auto;padding:28px 20px 60px}
h1{font-size:26px;margin:0 0 4px}
h2{font-size:18px;margin:34px 0 8px}
section{background:#fff;border:1px solid #e3e5e8;border-radius:8px;padding:14px 20px 18px;margin:14px 0}
p{max-width:78ch;margin:8px 0}
.lead{font-size:16px}
.note{color:#5b616b;font-size:13px}
.scroll{overflow-x:auto}
table{border-collapse:collapse;font-size:13.5px;margin:8px 0;font-variant-numeric:tabular-nums}
th,td{padding:4px 8px;text-align:right;border-bottom:1px solid #eceef1;white-space:nowrap}
th:first-child,td:first-child{text-align:left}
th{font-weight:600;color:#434954;border-bottom:1px solid #b9bec6;white-space:normal;vertical-align:bottom}
table.text td{text-align:left}
table.text th{text-align:left}
tr.ours td{background:#eef4fb}
tr.group td{font-weight:600;color:#434954;padding-top:12px}
.row{display:flex;flex-wrap:wrap;gap:14px}
.row figure{flex:1 1 380px}
figure{margin:8px 0}
figure svg{max-width:100%;height:auto}
figcaption{color:#5b616b;font-size:13px}
pre{background:#f2f3f5;border-radius:6px;padding:10px 12px;overflow-x:auto;font-size:12.5px}
.cards{display:flex;flex-wrap:wrap;gap:12px;margin:14px 0}
.card{background:#fff;border:1px solid #e3e5e8;border-radius:8px;padding:10px 16px;flex:1 1 150px}
.card b{display:block;font-size:22px}
.card span{color:#5b616b;font-size:13px}
"""


def page(title: str, body: Sequence[str]) -> str:
    """Return the page; `body` is HTML."""
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(title)}</title><style>{STYLE}</style></head>\n<body><main>\n"
        + "\n".join(body)
        + "\n</main></body></html>\n"
    )


def section(title: str, *parts: str) -> str:
    """Return a section with a heading; `parts` are HTML."""
    return f"<section><h2>{escape(title)}</h2>\n" + "\n".join(parts) + "\n</section>"


def paragraph(text: str, kind: str = "") -> str:
    """Return a paragraph of plain text."""
    return f'<p class="{kind}">{escape(text)}</p>' if kind else f"<p>{escape(text)}</p>"


def table(head: Sequence[str], rows: Sequence[Sequence[str]], *, ours: Sequence[int] = ()) -> str:
    """Return a table of plain texts.

    A row of one text is a group's heading; `ours` are rows to stand out. Numbers stand to the right, but a
    table of two columns explains words.
    """
    lines = ["<tr>" + "".join(f"<th>{escape(text)}</th>" for text in head) + "</tr>"]
    for index, row in enumerate(rows):
        if len(row) == 1:
            lines.append(f'<tr class="group"><td colspan="{len(head)}">{escape(row[0])}</td></tr>')
            continue
        cells = "".join(f"<td>{escape(text)}</td>" for text in row)
        lines.append(f'<tr class="ours">{cells}</tr>' if index in ours else f"<tr>{cells}</tr>")
    kind = ' class="text"' if len(head) == 2 else ""
    return f'<div class="scroll"><table{kind}>' + "\n".join(lines) + "</table></div>"


def figure(svg: str, caption: str) -> str:
    """Return a figure with a caption."""
    return f"<figure>{svg}<figcaption>{escape(caption)}</figcaption></figure>"


def cards(items: Sequence[tuple[str, str]]) -> str:
    """Return big numbers, each with what it says."""
    parts = "".join(f'<div class="card"><b>{escape(n)}</b><span>{escape(w)}</span></div>' for n, w in items)
    return f'<div class="cards">{parts}</div>'


def code(text: str) -> str:
    """Return preformatted text."""
    return f"<pre>{escape(text)}</pre>"
