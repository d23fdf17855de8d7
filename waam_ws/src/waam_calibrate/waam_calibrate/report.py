"""The report of a calibration: one HTML page that needs nothing else. Pure."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from html import escape

from .results import Result
from .shapers import Candidate

STYLE = """body{font:15px sans-serif;max-width:60em;margin:2em auto;color:#222}
table{border-collapse:collapse;margin:1em 0}td,th{border:1px solid #ccc;padding:.3em .7em;text-align:right}
td:first-child,th:first-child{text-align:left}
p.note{white-space:pre-wrap;font-family:monospace;margin:.2em 0}img{max-width:100%}.bad{color:#b00020}"""


def page(result: Result, pictures: Sequence[bytes] = (), notes: Sequence[str] = ()) -> str:
    """HTML text; pictures: PNG bytes."""
    judged = (
        f'<p class="bad">A job will refuse: {escape(result.refuses)}</p>' if result.refuses else ''
    )
    images = ''.join(map(image, pictures))
    said = ''.join(f'<p class="note">{escape(note)}</p>' for note in notes)
    told = _rows('settings for the controller', [(n, f'{v:g}') for n, v in result.settings])
    return (
        f'<!doctype html><meta charset="utf-8"><title>{escape(result.name)}</title><style>{STYLE}</style>'
        f'<h1>Calibration {escape(result.name)}</h1><p>{escape(result.date)}</p>'
        f'<p><b>{escape(result.text)}</b></p>{judged}{said}{images}'
        f'{_rows("found", [(n, f"{v:.6g}") for n, v in result.values.items()])}'
        f'{_rows("evidence", [(n, f"{v:.6g}") for n, v in result.evidence.items()])}{told}'
    )


def image(png: bytes) -> str:
    """HTML of a picture that is part of the page."""
    return f'<img alt="" src="data:image/png;base64,{base64.b64encode(png).decode()}">'


def _rows(title: str, rows: Sequence[tuple[str, str]]) -> str:
    if not rows:
        return ''
    body = ''.join(f'<tr><td>{escape(n)}</td><td>{escape(v)}</td></tr>' for n, v in rows)
    return f'<table><tr><th colspan="2">{escape(title)}</th></tr>{body}</table>'


def log_lines(candidates: Sequence[Candidate], chosen: Candidate) -> list[str]:
    """The log of the source: shaper, frequency, vibration, smoothing, acceleration; and the vibration that remains with
    the modes elsewhere than where they were measured."""
    lines = []
    for c in candidates:
        mark = '   <- taken' if c is chosen else ''
        uncertain = '' if c.vibration_off is None else f'15 % off {100 * c.vibration_off:5.1f} %   '
        lines.append(
            f'{c.type:9s} {c.hz:6.1f} Hz   vibration {100 * c.vibration:5.1f} %   {uncertain}'
            f'smoothing {c.smoothing:.3f} mm   acceleration <= {c.acceleration:.0f} mm/s^2{mark}'
        )
    return lines
