"""Stands for `waam commission --json`: the lines of the real one, without a cell. Words: FOLDER, those of the panel.

Answers go to FOLDER/answers; the step `crash` dies, `long` asks for three lengths, any other asks once."""

from __future__ import annotations

import json
import signal
import sys
from pathlib import Path

from waam_calibrate.commission import BUILT, Book, Outcome
from waam_calibrate.commission_page import rows


def main() -> int:
    signal.signal(signal.SIGINT, signal.default_int_handler)
    folder, asked = Path(sys.argv[1]), sys.argv[2:]
    book = Book('gantry1', 'm').with_run(
        'link', Outcome(True, '0 lost', pictures=('link.png',), job=str(folder / 'jobs' / 'one')), '2026-11-29', '1'
    )  # fmt: skip
    told = {
        'cell': 'gantry1', 'file': str(folder / 'gantry1.yaml'), 'page': str(folder / 'page.html'),
        'passed': 1, 'of': len(BUILT), 'at': 'settings', 'steps': rows(book),
    }  # fmt: skip
    if '--list' in asked:
        say(**told)
        return 0
    step = asked[asked.index('--step') + 1] if '--step' in asked else ''
    if step == 'crash':
        print('waam: error: no graph is up', file=sys.stderr)
        return 2
    say(say='settings: against the file', book=told)
    number = {'low': 10.0, 'high': 400.0, 'unit': 'mm', 'count': 3 if step == 'long' else 1}
    question = {
        'ask': 'steps.x',
        'text': 'How far did X go?',
        'words': [],
        'file': False,
        'wrong': '',
    } | number
    if step == 'file':
        question |= {'words': ['no'], 'file': True, 'unit': ''}
    say(**question)
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
