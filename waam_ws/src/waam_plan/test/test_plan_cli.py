"""The plan verb from the command line to the files, and plans on disk."""

import argparse
import json
import re

import numpy as np
import pytest
import trimesh
from robot_read_fanuc import read_ls

from waam_plan import cli, cli_robot
from waam_plan.gcode.store import load_plan, save_plan
from waam_plan.import_gcode.files import load_program
from waam_plan.layers.build import plan_build
from waam_plan.mesh.part import load_part
from waam_plan.plan import PlanError
from waam_plan.preview.picture import estimates, table
from waam_plan.settings import PlanSettings


def parse(*words):
    parser = argparse.ArgumentParser()
    cli.register(parser.add_subparsers(required=True))
    return parser.parse_args(['plan', *map(str, words)])


def waam(*words):
    args = parse(*words)
    return args.run_command(args)


def test_build_writes_everything(box_file, tmp_path, capsys):
    out = tmp_path / 'out'
    assert waam(box_file((40, 30, 8)), '--layers', 2, '--out', out) == 0
    assert {p.name for p in out.iterdir()} == {
        'program.gcode',
        'segments.csv',
        'plan.npz',
        'preview.png',
        'preview.html',
    }
    assert len(load_program(out / 'program.gcode').motions) > 100
    assert (out / 'preview.png').read_bytes()[:4] == b'\x89PNG'
    printed = capsys.readouterr().out
    assert len(re.findall(r'^ +[12] .*\d\.\d%$', printed, re.M)) == 2
    assert re.search(
        r'^what will come out of it: waam forecast .* --layers 2 --out ', printed, re.M
    )
    assert len(load_plan(out / 'plan.npz').layers) == 2


def test_fanuc_files_are_written_and_their_saving_told(box_file, tmp_path, capsys):
    out = tmp_path / 'out'
    assert waam(box_file((40, 30, 8)), '--post', 'fanuc', '--out', out) == 0
    files = {p.name: p.read_text() for p in out.glob('*.LS')}
    assert 'WAAM.LS' in files and any(m.arc for m in read_ls(files))
    assert re.search(r'\d+ points instead of \d+, \d+% saved', capsys.readouterr().out)


def test_the_reach_is_that_of_the_cell_file_or_said_to_be_assumed(box_file, capsys):
    part = box_file((40, 30, 8))
    asked = []

    def reach(name, build):
        asked.append((name, build))
        return {'machine_min': (0.0, 0.0, 0.0), 'machine_max': (0.03, 0.5, 0.5)}, 'cells/small.yaml'

    def plan(*words, of_cell=None):
        args = parse(part, '--layers', 1, *words)
        args.cell_reach = of_cell
        return args.run_command(args), capsys.readouterr()

    status, told = plan()
    assert status == 0 and 'machine: 400 x 300 x 200 mm' in told.out and 'assumed' in told.out
    status, told = plan('--cell', 'small', of_cell=reach)
    assert status == 2 and 'machine: 30 x 500 x 500 mm, work zero at' in told.out
    assert 'cells/small.yaml' in told.out and 'outside the machine' in told.err
    assert asked == [('small', True)]
    plan('--machine', 'robot', of_cell=reach)
    assert len(asked) == 1, 'a robot has a box of its own'


def test_programs_for_robots_are_written(box_file, tmp_path):
    out, cell = tmp_path / 'out', tmp_path / 'cell.yaml'
    cell.write_text('origin: [-0.015, -0.01, 0.0]\nfanuc: {lead: 0.2}\n')
    words = (
        '--layers',
        1,
        '--post',
        'kuka',
        '--out',
        out,
        '--robot-cell',
        cell,
        '--positioner',
        'turn',
    )
    assert waam(box_file((30, 20, 6)), *words, '--corner', 0.05) == 0
    assert {p.name for p in out.glob('WAAM*')} == {'WAAM.src', 'WAAM001.src', 'WAAM001.dat'}


@pytest.mark.parametrize('option', ['--robot-cell', '--cell'])  # the second is its old name
@pytest.mark.parametrize(
    'text, told', [('corner: 9', 'cell.yaml: corner is 9'), ('a: [', 'cell.yaml: no YAML')]
)
def test_a_bad_cell_file_is_told(text, told, option, box_file, tmp_path, capsys):
    cell = tmp_path / 'cell.yaml'
    cell.write_text(text)
    words = ('--layers', 1, '--post', 'abb', '--out', tmp_path / 'out', option, cell)
    assert waam(box_file((30, 20, 6)), *words) == 2
    assert told in capsys.readouterr().err


def test_compact_gcode_is_written_within_the_tolerance_asked_for(tmp_path, capsys):
    part = tmp_path / 'disc.stl'
    trimesh.creation.cylinder(radius=18, height=4, sections=96).export(part)
    arcs = []
    for tolerance in ('0.02', '0.06'):
        out = tmp_path / tolerance
        words = ('--strategy', 'contour', '--post', 'gcode-compact', '--tolerance', tolerance)
        assert waam(part, *words, '--out', out) == 0
        text = (out / 'compact.gcode').read_text()
        arcs.append(len(re.findall(r'^G[23] ', text, re.M)))
        found = re.search(r'(\d+) moves instead of (\d+), \d+% saved', capsys.readouterr().out)
        assert int(found[1]) == len(re.findall(r'^G[123] ', text, re.M))
        program = (out / 'program.gcode').read_text()
        assert int(found[2]) == len(re.findall(r'^G1 ', program, re.M))
    assert arcs[0] < arcs[1]


def test_restore_from_two_meshes(tmp_path, box_file):
    worn = trimesh.creation.box(extents=(60, 40, 14))
    worn.apply_translation((0, 0, -3))
    worn.export(tmp_path / 'worn.stl')
    plan = cli.make_plan(parse(box_file(), '--as-found', tmp_path / 'worn.stl'))
    assert plan.mode == 'restore' and len(plan.layers) == 3 and plan.name == 'box'
    np.testing.assert_allclose(plan.final_target[plan.region], 0.020, atol=1e-8)
    plan.as_found.save_npz(tmp_path / 'scan.npz')
    again = cli.make_plan(parse(box_file(), '--as-found', tmp_path / 'scan.npz'))
    assert again.layers[0].segments == plan.layers[0].segments


def test_options_reach_the_settings(box_file):
    options = ['--layer-height', 1, '--bead-width', 4, '--speed', 8, '--direction', 'y']
    s = cli.make_plan(parse(box_file((30, 20, 4)), *options, '--set', 'clearance=0.02')).settings
    assert (s.layer_height, s.bead_width, s.speed) == pytest.approx((1e-3, 4e-3, 8e-3))
    assert s.direction == 'y' and s.clearance == 0.02


@pytest.mark.parametrize(
    ('options', 'word'),
    [
        (['--layer-height', 50], 'layer_height'),
        (['--set', 'nonsense=1'], 'nonsense'),
        (['--set', 'speed=fast'], 'speed=fast'),
        (['--mode', 'restore'], '--as-found'),
        (['--scale', 1], 'wrong units'),
        (['--layers', -1], 'layers'),
    ],
)
def test_errors_are_one_line_and_leave_nothing(box_file, tmp_path, capsys, options, word):
    out = tmp_path / 'out'
    assert waam(box_file(), '--out', out, *options) == 2
    text = capsys.readouterr().err
    assert word in text and text.count('\n') == 1 and 'Traceback' not in text
    assert not out.exists()


def test_as_found_equal_to_the_part_leaves_nothing_to_do(box_file, capsys):
    path = box_file()
    assert waam(path, '--as-found', path) == 2
    assert 'nothing to' in capsys.readouterr().err


def test_a_stored_plan_is_the_same_plan(box_file, tmp_path):
    plan = plan_build(load_part(box_file((30, 20, 4))), PlanSettings())
    save_plan(plan, tmp_path / 'p.npz')
    again = load_plan(tmp_path / 'p.npz')
    assert again.settings == plan.settings and again.spec == plan.spec
    assert again.safe_z == plan.safe_z and again.offset == plan.offset
    for a, b in zip(plan.layers, again.layers, strict=True):
        assert a.segments == b.segments
        np.testing.assert_allclose(a.planned, b.planned, atol=1e-8)
        np.testing.assert_array_equal(a.footprint, b.footprint)
    assert [a.beside for a in plan.layers] == [b.beside for b in again.layers]
    assert all(a.beside > 0 for a in plan.layers)


def test_a_plan_that_was_stored_without_metal_beside_it_still_loads(box_file, tmp_path):
    save_plan(plan_build(load_part(box_file((30, 20, 4))), PlanSettings()), tmp_path / 'p.npz')
    with np.load(tmp_path / 'p.npz') as stored:
        np.savez(tmp_path / 'old.npz', **{k: stored[k] for k in stored.files if k != 'beside'})
    old = load_plan(tmp_path / 'old.npz')
    assert len(old.layers) == 2 and [p.beside for p in old.layers] == [0.0, 0.0]


def test_a_plan_that_was_stored_with_a_setting_that_is_gone_still_loads(box_file, tmp_path):
    plan = plan_build(load_part(box_file((30, 20, 4))), PlanSettings())
    save_plan(plan, tmp_path / 'p.npz')
    for name, known in (('scanner_trails', True), ('scanner_rails', False)):
        with np.load(tmp_path / 'p.npz') as stored:
            about = json.loads(str(stored['about']))
            about['settings'][name] = False
            columns = {k: stored[k] for k in stored.files} | {'about': np.array(json.dumps(about))}
            np.savez(tmp_path / 'old.npz', **columns)
        if known:
            assert load_plan(tmp_path / 'old.npz').settings == plan.settings
        else:
            with pytest.raises(PlanError, match=name):
                load_plan(tmp_path / 'old.npz')


@pytest.mark.parametrize('data', [b'', b'not a zip', None])
def test_what_is_no_plan_is_refused(tmp_path, data):
    path = tmp_path / 'p.npz'
    if data is None:
        np.savez(path, z=np.zeros(3))
    else:
        path.write_bytes(data)
    with pytest.raises(PlanError, match='not a stored plan'):
        load_plan(path)


def test_estimates_add_up(box_file):
    plan = plan_build(load_part(box_file((30, 20, 6))), PlanSettings())
    found = estimates(plan)
    assert sum(e.wire for e in found) == pytest.approx(plan.wire)
    assert sum(e.duration for e in found) == pytest.approx(plan.duration)
    assert all(e.mass_share == pytest.approx(1.0, abs=0.02) for e in found)
    assert len(table(plan).splitlines()) == len(found) + 2


def test_a_program_of_a_slicer_is_checked_and_shown(programs, tmp_path, capsys, monkeypatch):
    out = tmp_path / 'out'
    file = programs / 'cura_pad.gcode'
    assert waam(file, '--dialect', 'slicer', '--view', '--out', out) == 0
    assert 'cura_pad.gcode: 4 layers, 32 beads; its path stays' in capsys.readouterr().out
    assert len(load_plan(out / 'plan.npz').layers) == 4
    assert (out / 'preview.html').stat().st_size > 10_000
    monkeypatch.chdir(tmp_path)
    assert waam(programs / 'prusaslicer_disc.gcode', '--dialect', 'slicer', '--view') == 0
    assert f'written: {tmp_path / "preview.png"}' in capsys.readouterr().out
    assert waam(file) == 2  # another dialect
    assert 'line 13: M104: means nothing in dialect waam' in capsys.readouterr().err
    assert waam(tmp_path / 'part.stl', '--dialect', 'slicer') == 2
    assert 'belong to a program' in capsys.readouterr().err


@pytest.mark.parametrize(
    ('text', 'said'),
    [
        (None, 'No such file'),
        ('{', 'no YAML'),
        ('bridge: {ros__parameters: {work_high: 3}}', 'three numbers'),
    ],
)
def test_a_parameter_file_that_cannot_be_used_is_named(tmp_path, text, said):
    file = tmp_path / 'robot.yaml'
    if text is not None:
        file.write_text(text)
    with pytest.raises(ValueError, match=f'--params-file .*robot.yaml: .*{said}'):
        cli_robot.box(argparse.Namespace(params_file=[file]))


def test_the_box_of_the_robot_is_that_of_the_plan(tmp_path):
    box, other = tmp_path / 'box.yaml', tmp_path / 'other.yaml'
    box.write_text('bridge: {ros__parameters: {work_high: [1.8, 0.3, 0.2]}}')
    other.write_text('cell: {ros__parameters: {seed: 3}}')
    found = cli_robot.box(argparse.Namespace(params_file=[box, other]))
    assert found == {'machine_max': pytest.approx((1.7, 0.22, 0.18))}
    with pytest.raises(ValueError, match='--params-file belongs to --machine robot'):
        cli_robot.check_arm(
            argparse.Namespace(urdf=None, turning=False, params_file=[box], machine='gantry')
        )


@pytest.mark.parametrize(
    ('words', 'said'),
    [
        (('--post', 'kuka'), '--post kuka needs --out DIR'),
        (('--corner', 1), '--corner belongs to --post fanuc | kuka | abb'),
        (
            ('--positioner', 'turn', '--post', 'gcode-compact'),
            '--positioner belongs to --post fanuc',
        ),
    ],
)
def test_options_of_a_program_that_would_do_nothing_are_refused(box_file, capsys, words, said):
    assert waam(box_file((40, 30, 8)), *words) == 2
    assert said in capsys.readouterr().err
