"""`waam cell`, and what a graph is told of a cell file."""

from __future__ import annotations

import re

import pytest
import yaml

from waam_bringup import cell_check, cli, paths
from waam_bringup.calibrate import check_axis
from waam_bringup.cell_desk import laboratory, material, reach
from waam_bringup.cell_graph import PARAMETERS, apply
from waam_bringup.graph import GraphError, Settings, load, machine_steps, processes, told_to
from waam_bringup.operate import arguments, graph
from waam_calibrate.results import Result
from waam_calibrate.store import save
from waam_node.testing import fresh_domain
from waam_process.cell_file import CellError, new, parse
from waam_process.cell_keys import KEYS, PORT, PYROMETER

NEW = new('cell')


@pytest.fixture
def cells(tmp_path, monkeypatch):
    """A function that puts a cell file where it is looked for."""
    monkeypatch.setenv('WAAM_CELLS', str(tmp_path / 'cells'))
    monkeypatch.setenv('WAAM_CALIBRATIONS', str(tmp_path / 'calibrations'))
    monkeypatch.delenv('WAAM_CELL', raising=False)

    def put(*changes: tuple[str, str], name: str = 'cell') -> None:
        text = NEW
        for old, with_ in changes:
            assert old in text, old
            text = text.replace(old, with_)
        (tmp_path / 'cells').mkdir(exist_ok=True)
        (tmp_path / 'cells' / f'{name}.yaml').write_text(text)

    return put


DATE = '2026-11-01T10:00:00+00:00'


def found(axis: str, text: str, told: list[tuple[str, float]]) -> Result:
    """Of `waam calibrate steps`."""
    return Result('steps', axis, text, {}, settings=told, date=DATE)


def refused(capsys, *words: str) -> list[str]:
    assert cli.main(list(words)) == 2
    return capsys.readouterr().err.removeprefix('waam: error: ').splitlines()


def test_a_list_where_a_word_is_wanted_is_refused(cells, capsys):
    cells(('home: low', 'home: [low]'))
    first, second = refused(capsys, 'cell', 'check')
    assert first.endswith(":14: axes.x.home is ['low']: wanted is low or high")
    assert 'axes.y.home' in second


def test_a_new_cell_is_right_and_is_not_written_twice(cells, tmp_path, capsys):
    assert cli.main(['cell', 'new', 'gantry1']) == 0
    assert cli.main(['cell', 'check', 'gantry1']) == 0
    assert 'is there already' in refused(capsys, 'cell', 'new', 'gantry1')[0]
    assert 'no such file (waam cell new other)' in refused(capsys, 'cell', 'check', 'other')[0]
    assert 'is no name of a cell' in refused(capsys, 'cell', 'new', 'A/../b')[0]


@pytest.mark.parametrize(
    ('old', 'put', 'said'),
    [
        ('envelope_mm: 300', 'envelope_mm: 5000', r':16: axes.y.envelope_mm is 5000 mm, above its limit 3500 mm$'),
        ('accel_mm_s2: 300', 'accel_mm_s2: 9', r':25: axes.z.accel_mm_s2 is 9 mm/s2, below its limit 50 mm/s2$'),
        ('speed_mm_s: 100', 'speed_mm_s: 400', r':23: axes.z.speed_mm_s is 400 mm/s: with 320 steps/mm 128000 steps '
         r'per second, above the limit 77000'),
        ('zero_mm: [100,', 'zero_mm: [600,', r':50: work.zero_mm is at x 600 mm, outside 0 .. 400 mm'),
        ('plate_mm: [20, 20,', 'plate_mm: [20, 250,', r':51: work.plate_mm is at y 330 mm, outside 0 .. 300 mm'),
        ('envelope_mm: 400', 'envelope_mm: ' + '9' * 400, r'axes.x.envelope_mm is 9+: wanted is a number'),
        ('er70s-6', 'brass', r":47: source.material is 'brass', known are er70s-6"),
        ('# arc_speed_mm_s: [3, 20]', 'arc_speed_mm_s: [30, 20]', r'arc_speed_mm_s is \[30, 20\]: the lowest comes'),
        ('# low_c: 0', 'low_c: 0', 'low_c belongs to a pyrometer: sensors.pyrometer.source is missing'),
        ('# source: 4-20mA', 'source: 4-21mA', "source is '4-21mA', wanted is"),
        ('# source: none', 'source: sonar', "standoff.source is 'sonar', must be one of"),
        ('# calibration: /path', 'calibration: /path', r'calibration: /path/to/scanner.yaml: no such file'),
        ('# calibration: /path/to', 'calibration: to', 'give the whole path'),
    ],
)  # fmt: skip
def test_a_wrong_file_is_refused_with_file_line_key_limit_and_reason(cells, capsys, old, put, said):
    cells((old, put))
    lines = refused(capsys, 'cell', 'check')
    assert len(lines) == 1 and re.search(said, lines[0]), lines
    assert re.match(r'.*cell\.yaml:\d+: ', lines[0])


def test_settings_of_an_instrument_are_not_those_of_the_controllers_input(cells, capsys):
    cells(('# source: 4-20mA', 'source: serial:/dev/ttyUSB0'), ('# high_c', 'high_c'))
    assert 'instrument at the controller, the source is serial' in refused(capsys, 'cell', 'check')[0]  # fmt: skip
    cells(('# source: 4-20mA', 'source: 4-20mA'), ('# pattern', 'pattern'))
    assert 'instrument beside the controller, the source is 4-20mA' in refused(capsys, 'cell', 'check')[0]  # fmt: skip
    board = ('# source: 4-20mA', 'source: 4-20mA')
    cells(board, ('# low_c: 0', 'low_c: 900'), ('# high_c: 1000', 'high_c: 50'))
    said = refused(capsys, 'cell', 'check')[0]
    assert re.search(r":58: sensors.pyrometer.high_c: .*not above 'temperature_low'", said)


def test_limits_are_those_of_the_nodes_for_every_key():
    """A limit stands in one place: a key without a parameter is checked by its own rule."""
    ruled = {PORT, PYROMETER}
    for path, key in KEYS.items():
        nodes = [(n, p) for n, p in key.parameters if n in cell_check.NODES]
        assert nodes or path in ruled, path
        assert all(cell_check.field_of(n, p) for n, p in nodes)


def test_show_says_where_every_value_comes_from(cells, tmp_path, capsys):
    cells(('speed_mm_s: 100', 'speed_mm_s: 90'))
    result = found('x', '321.5 steps/mm', [('steps_per_mm_x', 321.5)])
    save(tmp_path / 'calibrations', result, '')
    assert cli.main(['cell', 'show']) == 0
    out = capsys.readouterr().out
    assert re.search(r'axes.z.speed_mm_s +90 mm/s +.*cell.yaml:23', out)
    by = r'calibration steps_x of 2026-11-01 10:00 \(nominal 320\)'
    assert re.search(rf'axes.x.steps_per_mm +321.5 1/mm +{by}', out)
    assert re.search(r'link.baud +921600 Bd +default of bridge', out)
    assert re.search(r'steps_x +2026-11-01 10:00 +321.5 steps/mm', out)
    assert all(path in out for path in KEYS)


def test_what_is_not_given_and_only_the_controller_knows_is_not_known(cells, capsys):
    cells(('    envelope_mm: 200', '    # envelope_mm: 200'))
    assert cli.main(['cell', 'show']) == 0
    assert re.search(
        r'axes.z.envelope_mm +not known +as the controller has it', capsys.readouterr().out
    )


def test_a_calibration_that_the_file_contradicts_is_named(cells, tmp_path, capsys):
    cells()
    result = found('z', '400', [('steps_per_mm_z', 400.0)])
    save(tmp_path / 'calibrations', result, '')
    said = refused(capsys, 'cell', 'check')[0]
    assert ':24: axes.z.steps_per_mm is 320, the calibration found 400: more than 5 %' in said


def test_diff(cells, capsys):
    cells()
    cells(
        ('rapid_mm_s: 50', 'rapid_mm_s: 80'), ('  # baud: 921600', '  baud: 921600'), name='other'
    )
    assert cli.main(['cell', 'diff', 'cell', 'other']) == 1
    assert capsys.readouterr().out.splitlines() == [
        'axes.rapid_mm_s: 50 -> 80',
        'link.baud: not given -> 921600',
    ]
    assert cli.main(['cell', 'diff', 'cell', 'cell']) == 0


def test_port_and_pyrometer_of_the_file_are_those_of_the_graph(cells, tmp_path):
    cells(('# port: /dev/serial/by-id/waam', 'port: /dev/mine'), ('# source: 4-20mA', 'source: 4-20mA'))  # fmt: skip
    real = apply(Settings(run=tmp_path), False)
    assert (real.settings.port, real.settings.pyrometer) == ('/dev/mine', '4-20mA')
    given = apply(Settings(run=tmp_path, port='/dev/other'), False)
    assert given.settings.port == '/dev/other'
    assert any('--port /dev/other counts, not' in text and 'link.port' in text for text in given.said)  # fmt: skip
    simulated = apply(Settings(run=tmp_path), True)
    assert simulated.settings.simulated and not simulated.settings.pyrometer
    processes(simulated.settings)


def test_a_file_without_a_port_is_of_a_simulated_cell(cells, tmp_path):
    cells(('# source: 4-20mA', 'source: 4-20mA'))
    settings = apply(Settings(run=tmp_path), False).settings
    assert settings.simulated and not settings.pyrometer
    processes(settings)


def test_what_a_parameter_file_says_against_the_file_is_named_and_refused_for_the_machine(
    cells, tmp_path
):
    cells()
    mine = tmp_path / 'mine.yaml'
    mine.write_text('/**/job_sequencer:\n  ros__parameters: {plate_zero: [0.0, 0.0, 0.0]}\n')
    said = apply(Settings(run=tmp_path, params_files=(mine,)), True).said
    assert 'job_sequencer plate_zero is [0.0, 0.0, 0.0] in a --params-file' in said[1]
    assert 'cell.yaml:51: work.plate_mm' in said[1] and 'the parameter file counts' in said[1]
    mine.write_text('/**/bridge:\n  ros__parameters: {envelope_x: 0.5}\n')
    with pytest.raises(GraphError, match=r'envelope_x is 0.5 .*cell.yaml:10: axes.x.envelope_mm is 400'):  # fmt: skip
        apply(Settings(run=tmp_path, params_files=(mine,)), True)
    mine.write_text('/**/bridge:\n  ros__parameters: {envelope_x: 0.4}\n')
    assert len(apply(Settings(run=tmp_path, params_files=(mine,)), True).said) == 1


X_STEPS = '    steps_per_mm: 320  # nominal'
CHUCK = (
    ('# steps_per_turn: 32000', 'steps_per_turn: 32000'),
    ('envelope_mm: 400', 'envelope_mm: 3500'),
)


def test_a_cell_with_a_chuck_in_place_of_x(cells, tmp_path, capsys):
    cells(*CHUCK)
    file = tmp_path / 'cells/cell.yaml'
    assert X_STEPS in file.read_text()
    file.write_text(file.read_text().replace(X_STEPS, '    # x', 1))
    assert cli.main(['cell', 'check']) == 0 and cli.main(['cell', 'show']) == 0
    assert 'chuck.steps_per_turn' in capsys.readouterr().out
    settings = apply(Settings(run=tmp_path), False).settings
    assert machine_steps(settings) == '32,320,320'
    assert told_to('cell', settings)['chuck_steps_per_turn'] == 32000
    assert told_to('job_sequencer', settings)['chuck_steps_per_turn'] == 32000
    with pytest.raises(GraphError, match='a chuck of a real machine is not built'):
        apply(Settings(run=tmp_path, port='/dev/ttyUSB0'), False)
    with pytest.raises(ValueError, match='the X axis is a chuck'):
        check_axis('x')
    check_axis('z')
    assert 'commissioning of a chuck is not built' in refused(capsys, 'commission')[0]


def test_what_does_not_go_with_a_chuck_is_named(cells, capsys):
    cells(CHUCK[0], ('# port:', 'port:'))
    said = '\n'.join(refused(capsys, 'cell', 'check'))
    assert 'axes.x.envelope_mm must be 3500 with a chuck' in said
    assert 'axes.x.steps_per_mm does not go with a chuck' in said
    assert 'link.port does not go with a chuck' in said
    cells(('# steps_per_turn: 32000', 'steps_per_turn: 200'), *CHUCK[1:])
    assert 'is 200, must be at least 10000' in refused(capsys, 'cell', 'check')[0]


def test_a_robot_does_not_take_the_file_of_a_gantry(cells, tmp_path):
    cells()
    with pytest.raises(GraphError, match='describes a gantry; a robot has parameters'):
        apply(Settings(run=tmp_path, machine='robot'), True)


def test_without_a_file_nothing_changes_and_that_is_said(cells, tmp_path):
    settings = Settings(run=tmp_path)
    applied = apply(settings, False)
    assert applied.settings == settings and 'cell file: none' in applied.said[0]


def test_the_supervisor_reads_no_cell_file_again(cells, tmp_path):
    cells(('steps_per_mm: 320', 'steps_per_mm: 200'))
    settings = apply(Settings(run=tmp_path), True).settings
    words = arguments(settings, 5)
    assert '--settings-are-whole' in words
    assert words.count(str(tmp_path / PARAMETERS)) == 1
    assert machine_steps(settings) == '200,200,200'
    assert told_to('job_sequencer', settings)['cell_file'].endswith('cells/cell.yaml')


def test_what_plan_laboratory_and_jobs_take_from_it(cells):
    cells(('er70s-6', '316l'))
    box, name = reach('', True)
    assert box['machine_max'] == pytest.approx((0.28, 0.2, 0.17)) and name.endswith('cell.yaml')
    told, wire, _ = laboratory('')
    assert told['cell']['work_zero'] == [0.1, 0.08, 0.02] and wire == '316l'
    assert material('') == '316l' and material('er4043') == 'er4043'
    with pytest.raises(ValueError, match='gone.yaml: no such file'):
        reach('gone', True)
    cells(('  zero_mm', '  # zero_mm'))
    with pytest.raises(CellError, match=r'cell.yaml: work.zero_mm: needed for a plan'):
        reach('', False)


def test_without_a_file_nothing_is_taken(cells):
    assert reach('', False) == ({}, '') and laboratory('') == ({}, '', '')
    assert material('') == 'er70s-6'


def test_the_controller_has_what_the_file_says(cells, tmp_path):
    """Real processes: rcl reads the parameter file, the bridge tells the controller, and says how far it reaches."""
    sizes = ('envelope_mm: 400', 'envelope_mm: 3000'), ('envelope_mm: 200', 'envelope_mm: 2000')
    cells(*sizes, ('home: low', 'home: high'))
    needed = {'virtual_controller', 'cell', 'bridge'}
    without = tuple(n for n in load() if n not in needed)
    settings = apply(Settings(run=tmp_path / 'run', without=without), True).settings
    with graph(settings, fresh_domain()) as (_, client):
        reached = client.until(
            lambda: (
                client.machine
                and (at := client.machine.limit_max)
                and (at.x, at.y, at.z) == (3.0, 0.3, 2.0)
            ),
            20.0,
        )
        assert reached


def test_parsed_by_the_core_as_by_the_desk(cells, tmp_path):
    cells()
    path = tmp_path / 'cells/cell.yaml'
    assert cell_check.load(path).values == parse(path.read_text(), 'x').values


MOUNT, PORT_LINE = '# mount_mm: [60, 0, 120]', '# port: /dev/serial/by-id/waam'


@pytest.mark.parametrize(
    ('given', 'own', 'taken'),
    [
        ('', {}, True),
        (MOUNT, {}, False),
        (PORT_LINE, {}, False),
        ('', {'mount_xyz': [0.06, 0.0, 0.12]}, False),
    ],
)
def test_the_scanner_sits_as_commissioned_unless_somebody_says_otherwise(
    cells, tmp_path, given, own, taken
):
    """Nor does that of a simulated cell sit as that of a real one."""
    cells(*([(given, given.removeprefix('# '))] if given else []))
    paths.scanner_calibration().parent.mkdir(parents=True)
    paths.scanner_calibration().write_text('read by scan_fusion alone')
    files = ()
    if own:
        files = (tmp_path / 'own.yaml',)
        files[0].write_text(yaml.safe_dump({'/**/scan_fusion': {'ros__parameters': own}}))
    made = apply(Settings(run=tmp_path / 'run', params_files=files), True)
    told = yaml.safe_load((tmp_path / 'run' / PARAMETERS).read_text()).get('/**/scan_fusion', {})
    assert ('calibration' in told.get('ros__parameters', {})) is taken
    assert any('scanner: as commissioned' in text for text in made.said) is taken
