"""Small pieces of HTML. Everything that comes from outside is escaped here."""

from __future__ import annotations

import base64
import html
import math
from collections.abc import Set as AbstractSet
from typing import Any

from waam_process import verdicts

VERDICTS = {  # class of the box of a verdict; others are bad
    **dict.fromkeys(verdicts.GOOD, 'ok'),
    **dict.fromkeys((*verdicts.REJECTED, verdicts.NOT_JUDGED), 'warn'),
}
STYLE = """
:root{color-scheme:light dark;--ink:#1f2933;--soft:#56616f;--line:#d9dde2;--back:#f5f6f8;--sheet:#fff;--flag:#fdf1ef}
:root{--ok:#1f7a3a;--bad:#b8322a;--warn:#8f5600;--head:#9aa5b1}
*{box-sizing:border-box}
body{font:14px/1.45 system-ui,"Segoe UI","DejaVu Sans",sans-serif;color:var(--ink);margin:0}
body{background:var(--back)}
main{max-width:1060px;margin:0 auto;padding:24px 28px;background:var(--sheet)}
h1{font-size:25px;margin:0 0 2px}h2{font-size:17px;margin:28px 0 8px;padding-top:12px;border-top:1px solid var(--line)}
h3{font-size:14px;margin:16px 0 4px}a{color:inherit}
p{margin:6px 0}.soft{color:var(--soft)}.mono{font-family:ui-monospace,"DejaVu Sans Mono",monospace;font-size:12px}
.verdict{margin:14px 0;padding:12px 18px;border-radius:6px;color:#fff;font-size:22px;font-weight:700}
.verdict small{display:block;font-size:14px;font-weight:400;margin-top:2px}
.ok{background:var(--ok)}.bad{background:var(--bad)}.warn{background:var(--warn)}
.cards{display:flex;flex-wrap:wrap;gap:8px;margin:10px 0}
.card{border:1px solid var(--line);border-radius:6px;padding:7px 12px;min-width:150px;flex:1}
.card b{display:block;font-size:18px;white-space:nowrap}.card span{font-size:12px;color:var(--soft)}
table{border-collapse:collapse;width:100%;font-size:12px;margin:6px 0}
th,td{padding:3px 6px;border-bottom:1px solid var(--line);text-align:right;vertical-align:top}
th{color:var(--soft);font-weight:600;border-bottom:1.5px solid var(--head)}
td.t,th.t{text-align:left}td.t{min-width:56px;overflow-wrap:anywhere}
tr.flag td{background:var(--flag)}tr.last td{font-weight:700}
img{max-width:100%;display:block;margin:6px auto;background:#fff}.pair{display:flex;gap:10px;flex-wrap:wrap}
.pair>figure{flex:1 1 280px;min-width:0}figure{margin:8px 0;break-inside:avoid}
figcaption{font-size:12px;color:var(--soft)}.scroll{overflow-x:auto}
.beside{display:flex;gap:14px;align-items:start}.beside figure{flex:1 1 68%;min-width:0}
.beside .cards{flex:1 1 180px;flex-direction:column}
.signs{display:flex;gap:24px;margin-top:52px;break-inside:avoid}
.sign{flex:1;border-top:1px solid var(--ink);padding-top:3px;font-size:12px;color:var(--soft)}
details{margin:8px 0}summary{cursor:pointer;color:var(--soft)}
:focus-visible{outline:3px solid #d46b00;outline-offset:2px}
pre{font-size:11px;background:var(--back);padding:10px;white-space:pre-wrap;overflow-wrap:anywhere}
@media (max-width:560px){.beside{flex-direction:column}
main{padding:12px}.signs{flex-direction:column;gap:44px}.card{min-width:130px}}
@media screen and (prefers-color-scheme:dark){
:root{--ink:#e6eaef;--soft:#aeb8c4;--line:#3b4550;--back:#0d1014;--sheet:#161b21;--flag:#3a2020;--head:#6b7785}
img{border-radius:4px}}
@media print{@page{size:A4;margin:12mm}body{background:#fff;font-size:11px}main{padding:0;max-width:none}
h2,h3{break-after:avoid}.verdict,.cards,tr{break-inside:avoid}thead{display:table-header-group}
.owner{break-after:page}.owner img{max-height:55mm}.owner p,.owner figure{margin:3px 0}.signs{margin-top:13mm}
.verdict{margin:8px 0;padding:8px 14px;font-size:18px}
.card{padding:4px 8px;min-width:90px}.card b{font-size:14px}.card span{font-size:10px}
table{font-size:9px}th,td{padding:2px 3px}.scroll{overflow:visible}img{max-height:240mm}
h2{margin:10px 0 4px;padding-top:6px;font-size:14px}
.pair{flex-wrap:nowrap}.pair>figure{min-width:0}details:not([open]){display:none}
.verdict,.card,tr.flag td{-webkit-print-color-adjust:exact;print-color-adjust:exact}}
"""


def escape(value: Any) -> str:
    """Text for element or attribute."""
    return html.escape(str(value), quote=True)


def fmt(value: Any, digits: int = 3, unit: str = '') -> str:
    """A number as text; a dash when there is none."""
    try:
        number = float(value)
    except (TypeError, ValueError):
        return '–'
    if not math.isfinite(number):
        return '–'
    text = f'{number:.{digits}f}'
    return f'{text} {unit}' if unit else text


def duration(seconds: Any) -> str:
    """s as '4.0 s', '3 min 20 s' or '2 h 05 min'; a dash for None, NaN and anything that is no number."""
    try:
        s = float(seconds)
    except (TypeError, ValueError):
        return '–'
    if not math.isfinite(s):
        return '–'
    if s < 60:
        return f'{s:.1f} s'
    hours, rest = divmod(round(s), 3600)
    minutes, left = divmod(rest, 60)
    return f'{hours} h {minutes:02d} min' if hours else f'{minutes} min {left:02d} s'


def picture(png: bytes, caption: str) -> str:
    """A figure with the PNG inside the page."""
    data = base64.b64encode(png).decode()
    text = escape(caption)
    return (
        f'<figure><img alt="{text}" src="data:image/png;base64,{data}">'
        f'<figcaption>{text}</figcaption></figure>'
    )


def card(value: str, label: str) -> str:
    """A figure and what it is; both are escaped."""
    return f'<div class="card"><b>{escape(value)}</b><span>{escape(label)}</span></div>'


def cards(items: list[tuple[str, str]]) -> str:
    """Pairs (value, label) side by side."""
    return '<div class="cards">' + ''.join(card(*i) for i in items) + '</div>'


def table(head: list[str], rows: list[list[Any]], left: set[int], flagged: AbstractSet[int] = frozenset(),
          last: bool = False) -> str:  # fmt: skip
    """`left`: columns with text; `flagged`: rows to be highlighted; `last`: the last row is bold."""

    def row(cells: list[Any], tag: str, style: str = '') -> str:
        inner = ''.join(
            f'<{tag}{" class=t" if i in left else ""}>{escape(c)}</{tag}>'
            for i, c in enumerate(cells)
        )
        return f'<tr{style}>{inner}</tr>'

    body = ''.join(
        row(
            cells,
            'td',
            ' class=flag' if i in flagged else ' class=last' if last and i == len(rows) - 1 else '',
        )
        for i, cells in enumerate(rows)
    )
    return f'<div class=scroll><table><thead>{row(head, "th")}</thead><tbody>{body}</tbody></table></div>'


def page(title: str, body: str) -> str:
    """A page of its own, style included. body is HTML and is not escaped."""
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f'<title>{escape(title)}</title><style>{STYLE}</style></head>\n'
        f'<body><main>{body}</main></body></html>\n'
    )
