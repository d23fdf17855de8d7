"""The cell file: what is understood, what it becomes, and how everything else is named."""

from __future__ import annotations

import math

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from waam_process.cell_file import CellError, alike, differing, new, parse
from waam_process.cell_keys import KEYS

NEW = new('gantry1')
FULL = '\n'.join(  # everything that a new file only shows
    line.replace('# ', '', 1) if line.strip().startswith('# ') and ': ' in line and line.startswith('  ') else line
    for line in NEW.splitlines()
)  # fmt: skip


def wrong(text: str) -> list[str]:
    with pytest.raises(CellError) as caught:
        parse(text, 'cells/a.yaml')
    return str(caught.value).splitlines()


def test_a_new_file_is_one_and_shows_every_key():
    cell = parse(NEW, 'cells/a.yaml')
    assert set(cell.values) == {k for k, key in KEYS.items() if key.given}
    assert set(parse(FULL, 'x').values) == set(KEYS)


def test_values_become_parameters_in_si():
    told = parse(FULL, 'x').parameters()
    bridge = told['bridge']
    assert (bridge['envelope_x'], bridge['max_speed_z'], bridge['steps_per_mm_y']) == (0.4, 0.1, 320.0)  # fmt: skip
    assert (bridge['home_direction_x'], bridge['max_accel_z'], bridge['rapid_speed']) == (-1, 0.3, 0.05)  # fmt: skip
    assert (bridge['arc_speed_min'], bridge['arc_speed_max']) == (0.003, 0.02)
    assert bridge['wire_feed_max'] == pytest.approx(0.2)
    scan = told['scan_fusion']
    assert scan['mount_xyz'] == [0.06, 0.0, 0.12]
    assert scan['mount_rpy'] == pytest.approx([0.0, 0.0, math.pi / 2])
    own = {'work_offset': [0.1, 0.08, 0.02], 'plate_zero': [0.02, 0.02, 0.01]}
    assert told['job_sequencer'] == {**own, 'chuck_steps_per_turn': 32000}
    assert 'cell' not in told


def test_a_simulated_cell_keeps_its_own_link_and_sensors():
    told = parse(FULL, 'x').parameters(simulated=True)
    assert set(told) == {'bridge', 'job_sequencer', 'thermal_compensator', 'cell'}
    assert told['cell'] == {'work_zero': [0.1, 0.08, 0.02], 'chuck_steps_per_turn': 32000}
    assert not {'baud', 'accelerometer_axes', 'temperature_low'} & set(told['bridge'])


def test_no_two_values_are_one_object():
    """rcl reads no YAML with aliases."""
    assert '&' not in yaml.safe_dump(parse(FULL, 'x').parameters(True))


@pytest.mark.parametrize(
    ('old', 'put', 'said'),
    [
        ('envelope_mm: 400', 'envelope_mm: 4e2', "cells/a.yaml:10: axes.x.envelope_mm is '4e2': wanted is a number"),
        ('envelope_mm: 400', 'envelope_mm: .inf', 'cells/a.yaml:10: axes.x.envelope_mm is inf: wanted is a number'),
        ('envelope_mm: 400', 'envelope_mm: true', 'cells/a.yaml:10: axes.x.envelope_mm is True: wanted is a number'),
        ('envelope_mm: 400', 'envelop_mm: 400', 'axes.x.envelop_mm is not known; did you mean axes.x.envelope_mm?'),
        ('home: low', 'home: left', "axes.x.home is 'left': wanted is low or high"),
        ('zero_mm: [100, 80, 20]', 'zero_mm: [100, 80]', 'work.zero_mm is [100, 80]: wanted is three numbers (mm)'),
        ('waam_cell: 1', 'waam_cell: 2', 'waam_cell is 2, must be 1'),
        ('waam_cell: 1', '', 'waam_cell is missing, must be 1'),
        ('source:', 'sauce:', 'sauce is not known; did you mean source?'),
        ('  material: er70s-6', 'material: er70s-6', 'material is not known'),
        ('er70s-6', '*a', 'no YAML (found undefined alias'),
        ('er70s-6', '!!python/object:os.system x', 'no YAML (could not determine a constructor'),
        ('er70s-6', '[a, b', 'no YAML'),
        ('plate_mm:', 'zero_mm:', 'work.zero_mm is there twice'),
    ],
)  # fmt: skip
def test_what_is_not_understood_is_named_with_file_line_and_key(old, put, said):
    found = wrong(NEW.replace(old, put, 1))
    assert any(said in line for line in found), found
    assert all(line.startswith('cells/a.yaml') for line in found)


def test_everything_wrong_is_said_at_once():
    text = NEW.replace('envelope_mm: 400', 'envelope_mm: x').replace('rapid_mm_s', 'rapid')
    assert len(wrong(text)) == 2


def test_a_heading_for_a_value_and_a_file_that_holds_itself_are_refused():
    assert 'axes.x holds no keys' in wrong('waam_cell: 1\naxes: {x: 3}')[0]
    assert 'not known' in wrong('waam_cell: 1\naxes: &a\n  x: *a')[0]
    assert 'no cell file' in wrong('- 1')[0] and 'no cell file' in wrong('')[0]
    assert 'longer than' in wrong('#' * 300_000)[0]


@given(st.text(max_size=300))
@settings(max_examples=200, deadline=None)
def test_any_text_is_a_cell_or_a_named_mistake(text):
    try:
        parse(text, 'a')
    except CellError as e:
        assert str(e).startswith('a')


def test_reach_in_the_work_frame():
    cell = parse(NEW, 'x')
    assert cell.box(False) == (pytest.approx((-0.1, -0.08, -0.02)), pytest.approx((0.3, 0.22, 0.18)))  # fmt: skip
    assert cell.box(True) == (pytest.approx((-0.12, -0.1, -0.03)), pytest.approx((0.28, 0.2, 0.17)))  # fmt: skip
    assert parse(NEW.replace('zero_mm', '# zero_mm'), 'x').box(False) is None


def test_the_hash_of_the_machine_is_of_what_the_controller_is_told():
    cell = parse(NEW, 'x')
    other = parse(NEW.replace('er70s-6', '316l') + '# a remark\n', 'x')
    assert other.machine_sha256 == cell.machine_sha256 and other.sha256 != cell.sha256
    assert parse(NEW.replace('400', '401'), 'x').machine_sha256 != cell.machine_sha256


def test_differences_name_line_and_parameter():
    cell = parse(NEW, 'a')
    has = cell.parameters()
    assert cell.differences(has, False) == {}
    has['bridge']['envelope_x'] = 0.5
    has['job_sequencer']['work_offset'] = [0.1, 0.08, 0.021]
    found = cell.differences(has, False)
    assert found['axes.x.envelope_mm'] == 'a:10: axes.x.envelope_mm is 400, bridge has envelope_x 0.5'  # fmt: skip
    assert set(found) == {'axes.x.envelope_mm', 'work.zero_mm'}
    assert cell.differences({}, False) == {}


def test_two_files_compared():
    a, b = parse(NEW, 'a'), parse(NEW.replace('rapid_mm_s: 50', 'rapid_mm_s: 80'), 'b')
    assert differing(a, b) == [('axes.rapid_mm_s', 50, 80)]
    assert differing(a, parse(NEW + '', 'c')) == []


def test_alike_forgives_rounding_only():
    assert alike(0.1 * 3, 0.3) and alike((0.1, 0.2), [0.1, 0.2]) and alike(1, 1.0)
    assert not alike(0.3, 0.30001) and not alike([0.1], [0.1, 0.2]) and not alike('a', 'b')
    assert not alike('x', 0.1)
