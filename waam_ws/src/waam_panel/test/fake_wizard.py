"""Stands for `waam commission --json`: the lines of the real one, without a cell. Words: FOLDER, those of the panel.

Answers go to FOLDER/answers; the step `crash` dies, `long` asks for three lengths, any other asks once."""

from __future__ import annotations

import json
import signal
import sys
from pathlib import Path

from waam_calibrate.commission import BUILT, Book, Check, Outcome
from waam_calibrate.commission_page import rows


def book_of(folder: Path) -> dict:
    """What `Shelf.told` says."""
    found = Outcome(
        True, '0 lost', (Check('frames lost', 0.0, 0.0, 1.0, '%'),), '', {'link.seen': 'yes'}, pictures=('link.png',),
        job=str(folder / 'jobs' / 'one'),
    )  # fmt: skip
    torn = Outcome(False, 'the switch of x was pressed', (), 'it is bridged')
    book = Book('gantry1', 'm').with_run('link', found, '2026-11-29T16:00:00+00:00', '1')
    book = book.with_run('limits', torn, '2026-11-29T16:01:00+00:00', '1')
    return {
        'cell': 'gantry1', 'file': str(folder / 'gantry1.yaml'), 'page': str(folder / 'page.html'),
        'passed': 1, 'of': len(BUILT), 'at': 'settings', 'steps': rows(book),
    }  # fmt: skip


def question_of(step: str) -> dict:
    """As `Lines.ask` asks it."""
    number = {'low': 10.0, 'high': 400.0, 'unit': 'mm', 'count': 3 if step == 'long' else 1}
    text = 'How far did X go, told 80, 200, 320 mm?'
    question = {'ask': 'steps.x', 'text': text, 'words': [], 'file': False, 'wrong': ''} | number
    return question | ({'words': ['no'], 'file': True, 'unit': ''} if step == 'file' else {})


def main() -> int:
    signal.signal(signal.SIGINT, signal.default_int_handler)
    folder, asked = Path(sys.argv[1]), sys.argv[2:]
    told = book_of(folder)
    if '--list' in asked:
        say(**told)
        return 0
    step = asked[asked.index('--step') + 1] if '--step' in asked else ''
    if step == 'crash':
        print('waam: error: no graph is up', file=sys.stderr)
        return 2
    say(say='settings: against the file', book=told)
    say(**question_of(step))
    (folder / 'answers').write_text(
        json.loads(sys.stdin.readline() or '{"answer": "nobody"}')['answer']
    )
    return 0


def say(**message: object) -> None:
    print(json.dumps(message), flush=True)


if __name__ == '__main__':
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        sys.exit(130)
