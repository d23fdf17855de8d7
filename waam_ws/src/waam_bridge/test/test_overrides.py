"""Factors of a process control beside the operator's: multiplied, bounded, and a lease."""

import math

import pytest
from bridge_cell import Cell

from waam_bridge import outbox, overrides


def told(cell: Cell) -> tuple[int, int]:
    cell.step(2)
    return cell.fake.speed, cell.fake.wire


def test_both_are_multiplied():
    cell = Cell().ready()
    overrides.operator(cell.bridge, 0.9, 1.1, 'panel', cell.now)
    overrides.process(cell.bridge, 1.05, 1.05, 'process_control', cell.now)
    assert told(cell) == (945, 1155)
    overrides.operator(cell.bridge, 1.0, math.nan, 'panel', cell.now)
    assert told(cell) == (1050, 1155)
    overrides.process(cell.bridge, 1.0, math.nan, 'process_control', cell.now)
    assert told(cell) == (1000, 1155)


def test_the_product_stays_in_the_operators_range():
    cell = Cell().ready()
    overrides.operator(cell.bridge, 1.9, 1.5, 'panel', cell.now)
    overrides.process(cell.bridge, 1.25, 1.25, 'process_control', cell.now)
    assert told(cell) == (2000, 1500)


def test_a_silent_control_loses_its_factors_and_the_operator_keeps_his():
    cell = Cell().ready()
    overrides.operator(cell.bridge, 0.9, 1.0, 'panel', cell.now)
    for _ in range(150):  # said again and again, it stays
        overrides.process(cell.bridge, 1.1, 1.1, 'process_control', cell.now)
        cell.step(1)
    assert told(cell) == (990, 1100)
    cell.step(110)
    assert told(cell) == (900, 1000)
    assert [n.text for n in cell.notices if 'silent' in n.text] == [
        'the process control is silent: its factors are 1 again'
    ]


@pytest.mark.parametrize('bad', [0.4, 1.6, -1.0, math.inf])
def test_what_is_out_of_range_is_refused_by_name(bad):
    cell = Cell().ready()
    overrides.process(cell.bridge, 1.1, bad, 'process_control', cell.now)
    assert told(cell) == (1000, 1000)
    assert cell.notices[-1].severity == outbox.WARNING
    assert f'wire_factor is {bad:g}, limits 0.5 .. 1.5' in cell.notices[-1].text


def test_the_same_factors_are_not_sent_again():
    cell = Cell().ready()
    overrides.process(cell.bridge, 1.1, 1.1, 'process_control', cell.now)
    cell.step(2)
    overrides.process(cell.bridge, 1.1001, 1.1, 'process_control', cell.now)
    assert not cell.bridge.link.out


def test_a_job_begins_with_factors_of_one_and_tells_what_was_in_force():
    cell = Cell().ready()
    overrides.operator(cell.bridge, 0.5, 1.2, 'panel', cell.now)
    assert told(cell) == (500, 1200)
    cell.bridge.armed('job_1', [], cell.now)
    assert told(cell) == (1000, 1000)
    (notice,) = [n for n in cell.notices if 'override' in n.text]
    assert notice.severity == outbox.WARNING
    assert 'speed 50%' in notice.text and 'wire 120%' in notice.text
    overrides.operator(cell.bridge, 0.9, math.nan, 'panel', cell.now)
    cell.bridge.armed('job_1', [], cell.now)  # the same job again keeps its factors
    assert told(cell) == (900, 1000)
