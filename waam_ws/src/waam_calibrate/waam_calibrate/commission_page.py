"""A commissioning to look at: the HTML file that needs nothing else, with a line to sign, and rows for a live page.
Pure."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from types import MappingProxyType
from typing import Any

from .commission import (
    BUILT,
    BY_HAND,
    NOT_DONE,
    NOT_THERE,
    PASSED,
    SEE,
    STEPS,
    Book,
    Check,
    Step,
    without,
)
from .report import STYLE, image

NONE: Mapping[str, bytes] = MappingProxyType({})
MARKS = """
h2{font-size:1.1em;margin:1.5em 0 .2em}.good{color:#1b6e2c}.open{color:#666}
.sign{margin-top:3em}.sign span{display:inline-block;min-width:18em;border-top:1px solid #222;margin-right:3em}"""


def page(book: Book, made: str, pictures: Mapping[str, bytes] = NONE) -> str:
    """HTML text. made: date of the page, ISO 8601; pictures: PNG bytes by the names that the book has."""
    done = book.due() is None
    said = f'{book.passed} of {len(BUILT)} steps passed{escape(without(book))}'
    by_hand = len(STEPS) - len(BUILT)
    whole = '' if done else ' <b class="bad">This cell is not ready.</b>'
    return (
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>Commissioning of {escape(book.cell)}</title>'
        f'<style>{STYLE}{MARKS}</style><h1>Commissioning of the cell {escape(book.cell)}</h1>'
        f'<p>{escape(made)} &middot; machine {escape(book.machine[:12])} of the cell file</p>'
        f'<p><b>{said}</b>; {by_hand} more are done by hand and count for nothing here.{whole}</p>'
        f'{"".join(_step(book, step, pictures) for step in STEPS)}'
        '<p class="sign"><span>date, name</span><span>signature</span></p></html>'
    )


def rows(book: Book) -> list[dict[str, Any]]:
    """Every step in order, as JSON takes it: what it is, its state, and what its last run found."""
    return [_row(book, step) for step in STEPS]


def _row(book: Book, step: Step) -> dict[str, Any]:
    row: dict[str, Any] = {
        'name': step.name, 'title': step.title, 'needs': step.needs, 'moves': step.moves, 'powered': step.powered,
        'built': step.built, 'after': list(step.after), 'state': book.state(step.name),
        'closed': book.closed(step.name),
    }  # fmt: skip
    entry = book.entries.get(step.name)
    if entry is None:
        return row
    found = entry.outcome
    return row | {
        'date': entry.date, 'firmware': entry.firmware, 'text': found.text, 'old': book.why_old(step.name),
        'mend': '' if found.passed else found.mend, 'job': found.job, 'pictures': list(found.pictures),
        'answers': dict(found.answers),
        'checks': [[c.name, f'{c.value:.4g} {c.unit}'.rstrip(), _limits(c), c.good] for c in found.checks],
    }  # fmt: skip


def _step(book: Book, step: Step, pictures: Mapping[str, bytes]) -> str:
    state = book.state(step.name)
    open_states = (NOT_DONE, BY_HAND, NOT_THERE)
    kind = 'good' if state == PASSED else 'open' if state in open_states else 'bad'
    head = f'<h2>{escape(step.name)}: <span class="{kind}">{escape(state)}</span></h2><p>{escape(step.title)}</p>'
    entry = book.entries.get(step.name)
    if not step.built:
        return f'{head}<p class="open">{escape(SEE)}</p>'
    if entry is None:
        return head
    outcome = entry.outcome
    why = book.why_old(step.name) if state not in (PASSED, NOT_DONE) and outcome.passed else ''
    lines = [f'{entry.date}, firmware {entry.firmware}', outcome.text]
    lines += [f'to mend: {outcome.mend}'] if outcome.mend and not outcome.passed else []
    lines += [f'out of date: {why}'] if why else []
    lines += [f'job: {outcome.job}'] if outcome.job else []
    told = ''.join(f'<p class="note">{escape(line)}</p>' for line in lines)
    drawn = ''.join(image(pictures[name]) for name in outcome.pictures if name in pictures)
    return head + told + _checks(outcome.checks) + drawn + _answers(dict(outcome.answers))


def _checks(checks: tuple[Check, ...]) -> str:
    if not checks:
        return ''
    rows = ''.join(
        f'<tr{"" if c.good else " class=bad"}><td>{escape(c.name)}</td><td>{c.value:.4g} {escape(c.unit)}</td>'
        f'<td>{escape(_limits(c))}</td></tr>'
        for c in checks
    )
    return f'<table><tr><th>found</th><th>value</th><th>limits</th></tr>{rows}</table>'


def _limits(check: Check) -> str:
    return f'{check.low:g} to {check.high:g} {check.unit}'.rstrip()


def _answers(answers: dict[str, str]) -> str:
    if not answers:
        return ''
    rows = ''.join(f'<tr><td>{escape(n)}</td><td>{escape(v)}</td></tr>' for n, v in answers.items())
    return f'<table><tr><th colspan="2">the operator said</th></tr>{rows}</table>'
