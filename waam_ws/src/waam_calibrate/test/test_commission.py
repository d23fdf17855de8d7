"""The book of a commissioning: gates, what is out of date, the file, the page; and what readings are judged as."""

from __future__ import annotations

import copy
import math
import re

import numpy as np
import pytest

from waam_calibrate import commission_checks as checks
from waam_calibrate.commission import (
    BUILT,
    BY_HAND,
    BY_NAME,
    FAILED,
    NOT_DONE,
    NOT_THERE,
    OUT_OF_DATE,
    STEPS,
    Book,
    Check,
    CommissionError,
    Outcome,
    from_data,
    table,
    to_data,
    wanted,
)
from waam_calibrate.commission_page import page

DATE = '2026-11-29T08:00:00+00:00'
GOOD = Outcome(True, 'fine', (Check('current', 0.1, -5, 5, 'A'),), '', {'estop.out': 'yes'})
BAD = Outcome(False, 'nobody saw <it>', (Check('current', math.nan, -5, 5, 'A'),), 'wire it')


def book(*runs: tuple[str, Outcome], machine: str = 'm1') -> Book:
    made = Book('gantry1', machine)
    for name, outcome in runs:
        made = made.with_run(name, outcome, DATE, '0.3.0')
    return made


def all_passed() -> Book:
    return book(*((s.name, GOOD) for s in BUILT))


def test_a_gate_is_always_before_its_step_and_there():
    seen: set[str] = set()
    for step in STEPS:
        assert set(step.after) <= seen, step.name
        assert not step.built or all(BY_NAME[g].built for g in step.after), step.name
        seen.add(step.name)


def test_the_steps_are_due_one_after_the_other_and_the_gates_open():
    made = book()
    order = []
    while (step := made.due()) is not None:
        assert made.closed(step.name) == []
        order.append(step.name)
        made = made.with_run(step.name, GOOD, DATE, '0.3.0')
    assert order == [s.name for s in BUILT] and made.passed == len(BUILT)


def test_a_failed_step_is_due_again_and_keeps_its_gate_closed():
    made = book(('link', GOOD), ('settings', GOOD), ('estop', BAD))
    assert made.state('estop') == FAILED and made.due() == BY_NAME['estop']
    assert made.closed('limits') == ['estop is failed']
    assert made.state('limits') == NOT_DONE


def test_a_step_that_is_repeated_makes_old_what_stands_on_it_and_nothing_else():
    made = all_passed().with_run('estop', GOOD, DATE, '0.3.0')
    old = {s.name for s in BUILT if made.state(s.name) == OUT_OF_DATE}
    after = {'gas', 'steps', 'skew', 'wire', 'resonance', 'scanner', 'arc', 'lead', 'bead', 'part'}
    assert old == {'limits', 'directions', 'homing'} | after
    assert made.why_old('limits') == 'estop was repeated'
    assert made.due() == BY_NAME['limits']


def test_another_machine_in_the_cell_file_makes_everything_old():
    made = from_data(to_data(all_passed()), 'gantry1', 'm2')
    assert made.passed == 0 and made.state('link') == OUT_OF_DATE
    assert 'cell file' in made.why_old('link')


def test_what_is_by_hand_never_counts():
    made = all_passed()
    by_hand = [s.name for s in STEPS if not s.built]
    assert by_hand == ['scales'] and made.passed == len(STEPS) - len(by_hand)
    for name in by_hand:
        assert made.with_run(name, GOOD, DATE, '0.3.0').state(name) == BY_HAND
        with pytest.raises(CommissionError, match='docs/real_cell.md'):
            wanted(name)
    assert f'{len(BUILT)} of {len(BUILT)} steps passed; {len(by_hand)} more done' in table(made)
    with pytest.raises(CommissionError, match="no step 'etsop'; known are link"):
        wanted('etsop')


def test_what_a_cell_has_not_is_no_failure_counts_for_nothing_and_ends_no_commissioning():
    absent = Outcome(False, 'no accelerometer', (), there=False)
    made = all_passed().with_run('resonance', absent, DATE, '0.3.0')
    assert made.state('resonance') == NOT_THERE and made.due() is None
    assert made.passed == len(BUILT) - 1
    assert 'steps passed, not there: resonance' in table(made)
    text = page(made, DATE)
    assert 'This cell is not ready' not in text and 'no accelerometer' in text
    read = from_data(copy.deepcopy(to_data(made)), 'gantry1', 'm1')
    assert read.state('resonance') == NOT_THERE
    again = read.with_run('steps', GOOD, DATE, '0.3.0')
    assert again.state('resonance') == OUT_OF_DATE, 'it is looked for again'


def test_pictures_and_jobs_of_a_step_are_on_its_page():
    shown = Outcome(True, 'fine', pictures=('scanner.png', 'gone.png'), job='/jobs/1_lead')
    made = book(('link', GOOD), ('scanner', shown))
    assert made.laid == {'scanner': '/jobs/1_lead'}
    assert from_data(copy.deepcopy(to_data(made)), 'gantry1', 'm1').entries == made.entries
    text = page(made, DATE, {'scanner.png': b'png'})
    assert text.count('data:image/png') == 1 and 'job: /jobs/1_lead' in text


def test_the_file_holds_the_book():
    made = book(('link', GOOD), ('estop', BAD))
    read = from_data(copy.deepcopy(to_data(made)), 'gantry1', 'm1')
    assert read.entries['link'] == made.entries['link']
    assert read.entries['estop'].outcome.mend == 'wire it'
    assert math.isnan(read.entries['estop'].outcome.checks[0].value)


@pytest.mark.parametrize(
    ('change', 'said'),
    [
        (lambda d: d.update(cell='other'), "belongs to the cell 'other'"),
        (lambda d: d['entries'][1]['outcome'].update(passed=True), 'changed by hand'),
        (lambda d: d.update(waam_commissioning=2), 'version 1'),
    ],
)
def test_a_file_that_cannot_be_used_is_refused(change, said):
    data = to_data(book(('link', GOOD), ('estop', BAD)))
    change(data)
    with pytest.raises(CommissionError, match=said):
        from_data(data, 'gantry1', 'm1')
    with pytest.raises(CommissionError, match='not a book'):
        from_data([1], 'gantry1', 'm1')


def test_the_page_shows_every_step_and_needs_no_network():
    text = page(book(('link', GOOD), ('estop', BAD)), DATE)
    for step in STEPS:
        assert f'<h2>{step.name}: ' in text
    assert text.count('by hand: see docs/real_cell.md') == sum(not s.built for s in STEPS)
    assert 'This cell is not ready' in text and 'signature' in text
    assert 'nobody saw &lt;it&gt;' in text and 'to mend: wire it' in text
    assert not re.search(r'https?:|<script|<link|src=', text)
    assert 'This cell is not ready' not in page(all_passed(), DATE)


def test_a_figure_that_is_not_a_number_is_not_good():
    assert Check('a', 5.0, -5, 5).good and not Check('a', math.nan, -5, 5).good


# ---- readings


def test_the_link():
    assert checks.link('WAAM_CONTROLLER_V1', '0.3.0', 100, 0).passed
    assert 'calls itself' in checks.link('GRBL', '0.3.0', 100, 0).text
    assert '0.3.0 at least' in checks.link('WAAM_CONTROLLER_V1', '0.2.9', 100, 0).text
    assert 'unknown' in checks.link('WAAM_CONTROLLER_V1', '', 100, 0).text
    assert 'frames lost' in checks.link('WAAM_CONTROLLER_V1', '0.3.0', 100, 5).text


def test_settings_that_differ_are_named_and_calibrated_steps_pass():
    want = {'steps_per_mm_x': 320.0, 'envelope_x': 400.0}
    assert checks.settings(want, {'steps_per_mm_x': 329.0}, (400, 300, 200)).passed
    off = checks.settings(want, {'steps_per_mm_x': 160.0}, (400, 300, 200))
    assert not off.passed and off.text.startswith('steps_per_mm_x 160')
    assert checks.settings(want, {'steps_per_mm_x': 320.0}, (300, 300, 200)).text.startswith(
        'envelope_x 300'
    )
    assert not checks.settings(want, {}, (400, 300, 200)).passed, 'steps that nobody tells'
    assert 'cell file says neither' in checks.settings({}, {}, (1, 1, 1)).text


def test_rest():
    quiet = np.zeros(50)
    assert checks.rest(quiet, quiet, quiet).passed
    assert checks.rest(quiet - 12.0, quiet, quiet).text.startswith('current -12')
    assert not checks.rest(quiet, quiet + 1.5, quiet).passed
    assert not checks.rest(quiet, quiet, np.r_[quiet, -3.0]).passed, 'a wheel that turns'


@pytest.mark.parametrize(
    ('read', 'passed', 'said'),
    [
        (52.4, True, '+4.8 %'),
        (-49.0, False, 'upside down'),
        (0.0, False, 'limits'),
        (40.0, False, 'limits'),
    ],
)
def test_a_known_current(read, passed, said):
    found = checks.signal('current', 50.0, np.full(20, read), 'A')
    assert found.passed is passed and said in found.text


def test_the_temperature():
    assert checks.temperature(21.0, 22.5, 9.0).passed
    swapped = checks.temperature(21.0, 22.5, -9.0)
    assert not swapped.passed and 'swapped' in swapped.mend
    assert not checks.temperature(21.0, 22.5, 0.3).passed
    assert not checks.temperature(21.0, 30.0, 9.0).passed
    assert not checks.temperature(150.0, 150.0, 9.0).passed


@pytest.mark.parametrize(
    ('read', 'told', 'said'),
    [
        (203.0, 200.0, ''),
        (190.0, 200.0, 'read less'),
        (80.0, 80.0, 'contact thermometer'),
        (math.nan, 200.0, 'read less'),
    ],
)
def test_hot_metal_against_a_contact_thermometer(read, told, said):
    found = checks.hot(read, told)
    assert found.passed is (said == '') and said in found.text


@pytest.mark.parametrize(
    ('told', 'way', 'mend'),
    [
        ('+x', '+x', ''),
        ('-z', '-z', ''),
        ('+x', '-x', 'other way'),
        ('+x', '+y', 'swapped'),
        ('+y', 'none', 'not move'),
    ],
)
def test_a_direction(told, way, mend):
    found = checks.direction(told[1], told, way)
    assert found.passed is (mend == '') and mend in found.mend


@pytest.mark.parametrize(
    ('fault', 'burnt', 'rest', 'flowed', 'said'),
    [
        (205, False, False, True, ''),
        (205, True, False, True, 'arc burnt'),
        (205, False, True, True, 'valve off'),
        (207, False, False, False, '207'),
        (205, False, False, False, 'flow switch'),
        (206, False, False, True, '206'),
    ],
)
def test_the_gas(fault, burnt, rest, flowed, said):
    found = checks.gas(fault, burnt, rest, flowed)
    assert found.passed is (said == '') and said in found.text
