"""The page Commissioning without a cell: one run, questions that wait, what is refused. A script is the wizard."""

from __future__ import annotations

import asyncio
import json
import signal
from pathlib import Path

import pytest
from panel_requests import ask, get, machine_says, tell, until

from waam_panel.commissioning import Commissioning
from waam_panel.setup_form import JobSetup

WIZARD = str(Path(__file__).with_name('fake_wizard.py'))


@pytest.fixture(autouse=True)
def interruptible():
    """As in a node: what a shell started in its background ignores SIGINT, and so would the children of these tests."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture
def commissioned(panel):
    """A panel that knows how to commission its cell."""
    panel.cell.commissioning = Commissioning((WIZARD, str(panel.folder)))
    yield panel
    panel.cell.commissioning.end()


def shown(panel) -> dict:
    return panel.cell.state.sections['commission']


def begins(panel, step: str = '') -> dict:
    """What is asked in a run that has begun."""
    assert ask(panel, 'commission/start', {'step': step})[0] == 200
    until(lambda: shown(panel)['asked'], 'nothing is asked')
    return shown(panel)['asked']


def ended(panel) -> str:
    until(lambda: not panel.cell.commissioning.running, 'it does not end')
    return panel.cell.commissioning.ended


def test_a_question_waits_and_takes_one_answer_as_people_type_it(commissioned):
    asked = begins(commissioned, 'long')
    number = asked['number']
    assert asked['text'].startswith('How far did X go') and shown(commissioned)['at'] == 'settings'
    for given in ('yes', ['80', '200'], ['80', '200', '401'], ['80', '200', '3O0'], [], 3, None):
        status, said = ask(commissioned, 'commission/answer', {'number': number, 'answer': given})
        assert status == 400 and said['message'].startswith('answer: '), given
    for other in (number - 1, number + 1, str(number), None):
        status, said = ask(
            commissioned, 'commission/answer', {'number': other, 'answer': ['80', '200', '300']}
        )
        assert status == 409 and 'not asked any more' in said['message'], other
    assert shown(commissioned)['asked'] == asked, 'it still waits'
    right = {'number': number, 'answer': ['79,9', '200.1 mm', 320]}
    assert ask(commissioned, 'commission/answer', right)[0] == 200
    assert ended(commissioned) == 'done'
    assert (commissioned.folder / 'answers').read_text() == '79.9 200.1 320'
    assert ask(commissioned, 'commission/answer', right)[0] == 409


def test_a_part_is_named_and_never_addressed(commissioned):
    parts = commissioned.folder / 'parts'
    parts.mkdir()
    (parts / 'pad.stl').write_text('solid')
    number = begins(commissioned, 'file')['number']
    for given in ('/etc/passwd', '../gantry1.yaml', 'other.stl', ''):
        status, _ = ask(commissioned, 'commission/answer', {'number': number, 'answer': given})
        assert status == 409, given
    ask(commissioned, 'commission/answer', {'number': number, 'answer': 'pad.stl'})
    assert ended(commissioned) == 'done'
    assert (commissioned.folder / 'answers').read_text() == str(parts / 'pad.stl')


def test_one_run_at_a_time_and_nothing_else_begins_beside_it(commissioned):
    machine_says(commissioned)
    commissioned.cell.setup = JobSetup('block.stl')
    begins(commissioned)
    for name, data in (
        ('commission/start', {}), ('load', {'part': 'block.stl'}), ('start', {}),
        ('load_job', {'id': 'x'}), ('queue_release', {'id': 1}), ('program/start', {}),
    ):  # fmt: skip
        status, said = ask(commissioned, name, data)
        assert status == 409 and 'commissioning runs' in said['message'], name
    assert ask(commissioned, 'commission/end', {})[0] == 200
    assert 'ended by hand' in ended(commissioned)
    assert not (commissioned.folder / 'answers').exists()
    assert ask(commissioned, 'commission/end', {})[0] == 409


def test_what_the_cell_measures_takes_no_word_of_a_person(commissioned):
    number = begins(commissioned)['number']
    run = commissioned.cell.commissioning
    run.asked = {'do': 'limits.x_low', 'text': 'Press it.', 'wait': False, 'number': number}
    status, said = ask(commissioned, 'commission/answer', {'number': number, 'answer': ''})
    assert status == 409 and 'for itself' in said['message']
    assert run.running and not (commissioned.folder / 'answers').exists()


def test_stop_ends_the_run(commissioned):
    begins(commissioned)
    assert ask(commissioned, 'stop')[0] == 200
    assert 'ended by hand' in ended(commissioned)
    assert commissioned.operations.asked == [('stop',)]


def test_stop_counts_before_the_process_is_there(tmp_path):
    async def go() -> str:
        run = Commissioning((WIZARD, str(tmp_path)))
        begins = asyncio.create_task(run.start(''))
        await asyncio.sleep(0)
        run.end()
        await begins
        async with asyncio.timeout(20):
            while run.running:
                await asyncio.sleep(0.02)
        return run.ended

    assert 'ended by hand' in asyncio.run(go())


def test_a_job_that_runs_keeps_it_from_beginning(commissioned):
    commissioned.living = ('job_sequencer',)
    tell(commissioned, 'job', commissioned.job('DEPOSITING'))
    status, said = ask(commissioned, 'commission/start', {})
    assert status == 409 and said['message'] == 'a job is running'


def test_why_it_does_not_run_is_said(commissioned, make_panel):
    assert ask(commissioned, 'commission/start', {'step': 'crash'})[0] == 200
    assert ended(commissioned) == 'no graph is up'
    for step in ('--answers', 3, 'x' * 300):
        assert ask(commissioned, 'commission/start', {'step': step})[0] == 400
    other = make_panel(name='other')
    status, said = ask(other, 'commission/start', {})
    assert status == 409 and 'command line' in said['message']
    assert 'command line' in json.loads(get(other, '/api/commission')[1])['message']


def test_the_book_its_files_and_nothing_beside_them(commissioned):
    folder = commissioned.folder
    (folder / 'jobs' / 'one').mkdir(parents=True)
    (folder / 'jobs' / 'one' / 'report.json').write_text('{}')
    for name in ('link.png', 'page.html', 'gantry1.yaml', 'book.yaml'):
        (folder / name).write_text(f'this is {name}')
    assert get(commissioned, '/commission/page.html')[0] == 404, 'nobody has looked yet'
    book = json.loads(get(commissioned, '/api/commission')[1])
    first, second = book['steps'][:2]
    assert first['state'] == 'passed' and first['report'] == '/jobs/one/report.html'
    assert second['report'] == '' and second['state'] == 'not done' and not second['moves']
    for name, inside in (('link.png',) * 2, ('page.html',) * 2, ('cell.yaml', 'gantry1.yaml')):
        assert get(commissioned, f'/commission/{name}') == (200, f'this is {inside}'.encode())
    for name in ('book.yaml', 'other.png', '..%2Fgantry1.yaml', '%2Fetc%2Fpasswd'):
        assert get(commissioned, f'/commission/{name}')[0] == 404, name
