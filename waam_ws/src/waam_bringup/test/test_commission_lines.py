"""`waam commission --json` without a cell: questions as lines, answers as lines, and what a person does meanwhile."""

from __future__ import annotations

import json
import subprocess
import sys
import time

from waam_bringup import commission_visit
from waam_bringup.commission_visit import Visit
from waam_calibrate.commission import BY_NAME, Book, Check, Outcome
from waam_calibrate.commission_page import rows

ASKS = """
from waam_bringup.commission_lines import Lines
from waam_bringup.commission_visit import Question
lines = Lines(lambda: {'at': 'steps'})
lines.say('     steps: begins')
print('a program that prints', flush=True)
lines.do('steps.x_zero', 'Set the gauge to zero.', True)
lines.say(lines.ask(Question('steps.x', 'How far?', low=10.0, high=400.0, unit='mm', count=2)))
lines.ask(Question('steps.ready', 'Ready?', ('yes', 'no')))
"""


def test_questions_are_lines_and_the_end_of_the_answers_is_ctrl_c():
    with subprocess.Popen(
        [sys.executable, '-c', ASKS], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as wizard:  # fmt: skip
        assert wizard.stdin and wizard.stdout

        def heard() -> dict:
            return json.loads(wizard.stdout.readline())

        def told(line: str) -> None:
            wizard.stdin.write(f'{line}\n')
            wizard.stdin.flush()

        assert heard() == {'say': 'steps: begins', 'book': {'at': 'steps'}}
        assert wizard.stdout.readline() == 'a program that prints\n'
        assert heard() == {
            'do': 'steps.x_zero',
            'text': 'Set the gauge to zero.',
            'wait': True,
            'seconds': 120.0,
        }
        told('{"answer": ""}')
        asked = heard()
        assert (asked['ask'], asked['low'], asked['high'], asked['count']) == (
            'steps.x',
            10.0,
            400.0,
            2,
        )
        assert asked['wrong'] == ''
        for wrong in ('{"answer": "80"}', '{"answer": "80 401"}', 'no json', '{}', '3'):
            told(wrong)
            assert heard() == asked | {'wrong': 'wanted is 2 numbers from 10 to 400 mm'}
        told('{"answer": "80.1, 200"}')
        assert heard()['say'] == '80.1 200'
        question = heard()
        assert question['words'] == ['yes', 'no'] and question['low'] is None
        wizard.stdin.close()
        assert wizard.wait(20) != 0 and 'KeyboardInterrupt' in wizard.stderr.read()


def test_what_the_cell_has_said_while_a_person_thought_is_taken_in(tmp_path, monkeypatch):
    """The torch may have been jogged meanwhile: `scanner` starts where it is now."""
    monkeypatch.setattr(commission_visit, 'MEANWHILE_S', 0.05)
    heard = []

    class Cell:
        fresh = staticmethod(heard.append)

    class Slow:
        def ask(self, question):
            time.sleep(0.1)
            return 'yes'

        def do(self, action, text, wait):
            if action.endswith('slow'):
                time.sleep(0.1)

    visit = Visit(BY_NAME['scanner'], Cell, Slow(), None, tmp_path)  # type: ignore[arg-type]
    visit.say('quick', 'Look.')
    assert heard == []
    visit.say('slow', 'Jog it there.')
    visit.ready('Ready?')
    assert heard == [1, 1]


def test_a_row_says_what_a_step_is_and_what_it_found():
    checks = Check('delay', 90.0, 0.0, 50.0, 'ms'), Check('noise', float('nan'), 0.0, 1.0)
    failed = Outcome(
        False,
        'delay 90 ms',
        checks,
        'the clock',
        {'scanner.ready': 'yes'},
        pictures=('scanner.png',),
    )
    by_name = {
        row['name']: row
        for row in rows(Book('gantry1', 'm').with_run('scanner', failed, '2026-11-29', '1'))
    }
    row = by_name['scanner']
    assert (
        row['state'] == 'failed'
        and row['mend'] == 'the clock'
        and row['closed'] == ['skew is not done']
    )
    assert row['checks'] == [
        ['delay', '90 ms', '0 to 50 ms', False],
        ['noise', 'nan', '0 to 1', False],
    ]
    assert by_name['link']['closed'] == [] and 'text' not in by_name['link']
    assert by_name['arc']['powered'] and by_name['arc']['needs'] and not by_name['scales']['built']
    json.dumps(by_name, allow_nan=False)
