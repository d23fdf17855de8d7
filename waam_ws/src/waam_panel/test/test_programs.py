"""The page "G-code": programs, their checks with line and word, layers, and the goal of a start. No graph."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from panel_requests import ask, get, machine_says, wall

from waam_calibrate import store
from waam_calibrate.results import Result
from waam_panel.program_look import Asked, look
from waam_panel.programs import ProgramChoice, ProgramRefused, parse_choice

MATERIALS = ('er70s-6', '316l')


def looked(tmp_path: Path, text: str, **asked) -> dict:
    file = tmp_path / 'wall.gcode'
    file.write_text(text)
    return look(Asked(file, **asked)).as_dict()


def levels(found: dict) -> list[str]:
    return [c['level'] for c in found['checks']]


def test_layers_and_beads_of_a_good_program(tmp_path):
    found = looked(tmp_path, wall(), limits=((-0.1,) * 3, (0.2,) * 3))
    assert found['good'] and levels(found) == ['good'] * 5
    assert [(x['number'], x['z_mm'], x['beads']) for x in found['layers']] == [(1, 0, 2), (2, 2, 2)]
    bead = found['beads'][1][1]
    assert bead['path'] == [[0, 4], [40, 4]] and bead['length_mm'] == 40.0
    assert wall().splitlines()[bead['line'] - 1] == 'G1 X40'
    assert found['box'] == [0, 0, 40, 4] and found['totals']['arc_time_s'] == pytest.approx(
        16, 0.05
    )


@pytest.mark.parametrize(
    ('change', 'check', 'line', 'word'),
    [
        (lambda t: t.replace('G1 X40', 'G1 X4Q0', 1), 'words', 9, 'Q'),
        (lambda t: t.replace('M5\n', '', 1), 'words', 10, 'Z12'),
        (lambda t: t.replace('G1 X40', 'G77 X40', 1), 'words', 9, 'G77'),
        (lambda t: t.replace('W4646', 'W90000'), 'speed, wire', 9, 'wire'),
        (lambda t: t.replace('F600', 'F9000'), 'speed, wire', 9, 'travel speed'),
        (lambda t: t.replace('G0 Z12', 'G0 Z0'), 'metal', 12, 'metal'),
        (lambda _: wall((8, 10)), 'metal', 9, 'above the surface'),
    ],
)
def test_what_is_wrong_is_named_by_line_and_word(tmp_path, change, check, line, word):
    found = looked(tmp_path, change(wall()))
    bad = [c for c in found['checks'] if c['level'] == 'bad']
    assert not found['good'] and bad[0]['name'].startswith(check), found['checks']
    assert bad[0]['line'] == line and word in bad[0]['text'], bad


def test_reach_names_line_and_axis(tmp_path):
    low = (-0.02, -0.02, -0.02)
    found = looked(tmp_path, wall(), limits=(low, (0.035, 0.1, 0.1)))
    reach = found['checks'][3]
    assert (reach['level'], reach['line']) == ('warning', 9) and 'X40.0' in reach['text']
    reach = looked(tmp_path, wall(), limits=(low, (0.015, 0.1, 0.1)))['checks'][3]
    assert (reach['level'], reach['line']) == ('bad', 9) and '40.0 mm long' in reach['text']
    assert looked(tmp_path, wall())['checks'][3]['level'] == 'warning'  # not known


def test_a_nominal_part_that_does_not_belong_is_told(tmp_path, write_part):
    nominal, _ = write_part(tmp_path)
    found = looked(tmp_path, wall(), nominal=nominal)
    assert levels(found)[-1] == 'bad' and 'nominal part does not end' in found['checks'][-1]['text']


@settings(max_examples=150, deadline=None, derandomize=True)
@given(st.dictionaries(
    st.sampled_from(['program', 'dialect', 'nominal', 'material', 'loop_mode', 'shift_mm', 'x']),
    st.one_of(st.none(), st.booleans(), st.floats(), st.text(max_size=90), st.sampled_from(['waam', 'monitor', '316l']),
              st.lists(st.one_of(st.floats(), st.none()), max_size=4)),
))  # fmt: skip
def test_any_choice_is_taken_whole_or_refused(data):
    try:
        choice = parse_choice(data, MATERIALS)
    except ProgramRefused as e:
        assert str(e)
        return
    assert choice.program and choice.material in MATERIALS and 'x' not in data
    assert all(abs(v) <= 1000 for v in choice.shift_mm)


def test_from_upload_to_start(panel):
    """The page's way: upload, check, layer, load, arm, start; and what is refused on it."""
    machine_says(panel)
    for name, text in (('wall.gcode', wall()), ('bad.nc', wall().replace('M5\n', '', 1))):
        assert ask(panel, f'programs?name={name}', text.encode())[1]['name'] == name
    assert {p['name'] for p in json.loads(get(panel, '/api/programs')[1])['programs']} == {
        'wall.gcode',
        'bad.nc',
    }
    assert ask(panel, 'programs?name=../x.gcode', b'G0')[0] == 409
    assert ask(panel, 'programs?name=x.stl', b'G0')[0] == 409
    status, refused = ask(panel, 'program/load', {'program': 'bad.nc'})
    assert status == 409 and 'line 10' in refused['message'] and 'Z12' in refused['message']
    good = {'program': 'wall.gcode', 'shift_mm': [5, 0, 0], 'operator_name': 'Ann'}
    status, said = ask(panel, 'program', good)
    assert status == 200 and said['good'] and 'beads' not in said and len(said['layers']) == 2
    status, second = ask(panel, 'program/layer', good | {'layer': 2})
    assert status == 200 and second['beads'][0]['path'][0] == [5, 0]
    assert ask(panel, 'program/layer', good | {'layer': 3})[1]['message'] == 'layer: 1 to 2'
    assert ask(panel, 'program/start', {})[1]['message'] == 'load the program first'
    assert ask(panel, 'program/load', good)[0] == 200
    assert panel.operations.asked[-1][0] == 'load' and panel.operations.asked[-1][1].mode == 'build'
    assert ask(panel, 'program/start', {})[1]['message'] == 'press Arm first'
    machine_says(panel, armed=True)
    assert ask(panel, 'program/start', {})[0] == 200
    name, choice, program, nominal, jobs = panel.operations.asked[-1]
    assert name == 'start_program' and program == (panel.folder / 'parts' / 'wall.gcode').resolve()
    assert choice == ProgramChoice('wall.gcode', shift_mm=(5.0, 0.0, 0.0), operator_name='Ann')
    assert nominal is None and jobs == panel.folder / 'jobs'
    program.write_text(wall().replace('G1 X40', 'G77 X40', 1))  # changed since it was loaded
    status, refused = ask(panel, 'program/start', {})
    assert status == 409 and 'G77' in refused['message']


def test_a_calibration_that_refuses_keeps_program_and_part_from_starting(panel, write_part):
    """As `waam job run` does; and both start once it was made anew."""
    folder = panel.cell.calibrations = panel.folder / 'calibrations'

    def skew(day: int, refuses: str) -> None:
        date = f'2026-11-{day:02d}T10:00:00+00:00'
        store.save(
            folder,
            Result('skew', '', 'y leans', {'y_to_x_deg': 0.9}, refuses=refuses, date=date),
            '',
        )

    machine_says(panel, armed=True)
    ask(panel, 'programs?name=wall.gcode', wall().encode())
    write_part(panel.folder / 'parts')
    for start, load in (
        ('program/start', ('program/load', {'program': 'wall.gcode'})),
        ('start', ('load', {'part': 'block.stl', 'as_found': 'block_worn.stl'})),
    ):
        assert ask(panel, *load)[0] == 200
        skew(1, 'y leans +0.900 deg to x')
        status, said = ask(panel, start, {})
        assert status == 409 and 'y leans +0.900 deg' in said['message']
        assert 'waam calibrate status' in said['message']
        skew(2, '')
        assert ask(panel, start, {})[0] == 200
        (folder / 'skew_20261102T100000Z.yaml').unlink()
    damaged = folder / 'skew_20261101T100000Z.yaml'
    damaged.write_text(damaged.read_text().replace('0.9', '0.1'))
    assert 'changed by hand' in ask(panel, 'start', {})[1]['message']


def test_a_part_that_is_loaded_takes_the_place_of_the_program(panel, write_part):
    machine_says(panel, armed=True)
    ask(panel, 'programs?name=wall.gcode', wall().encode())
    write_part(panel.folder / 'parts')
    assert ask(panel, 'program/load', {'program': 'wall.gcode'})[0] == 200
    assert ask(panel, 'start', {})[1]['message'] == 'load a part first'
    assert ask(panel, 'load', {'part': 'block.stl', 'as_found': 'block_worn.stl'})[0] == 200
    assert ask(panel, 'program/start', {})[1]['message'] == 'load the program first'
    assert not any(a[0] == 'start_program' for a in panel.operations.asked)


def test_the_goal_is_that_of_the_command_line(tmp_path):
    """As `waam job run wall.gcode --nominal part.stl --dialect slicer --shift 5 0 0` makes it."""
    from waam_panel.conversions import program_goal

    choice = ProgramChoice('wall.gcode', 'slicer', 'part.stl', '316l', 'closed_loop', (5.0, 0, 0))
    goal = program_goal(choice, tmp_path / 'wall.gcode', tmp_path / 'part.stl', tmp_path / 'jobs')
    assert (goal.program, goal.part) == (str(tmp_path / 'wall.gcode'), str(tmp_path / 'part.stl'))
    assert (goal.dialect, goal.mode, goal.material) == ('slicer', 'build', '316l')
    assert goal.program_shift.x == 5e-3 and goal.loop_mode == 'closed_loop'
    assert goal.scale == 1e-3 and json.dumps(list(goal.notes)) == '["started_from=panel"]'
