"""Goal, folder, geometry, telemetry sums."""

from __future__ import annotations

import json
import math
import pickle
import zipfile
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from builtin_interfaces.msg import Time
from hypothesis import given
from hypothesis import strategies as st

from waam_job.conversions import (
    begin_request,
    goal_from_job,
    goal_from_msg,
    scan_from_msg,
    scan_to_msg,
)
from waam_job.model.cell import Scan
from waam_job.model.geometry import (
    asked_growth,
    deviation,
    driven_growth,
    follow,
    laid_beads,
)
from waam_job.model.goal import Code, JobError, JobGoal, check, planner_fields
from waam_job.model.limits import K_GAIN_MAX
from waam_job.model.records import LayerRecord
from waam_job.model.telemetry import TelemetryStats
from waam_job.ros.node_requests import new_folder
from waam_job.store.folder import JobFolder, clean
from waam_msgs.action import RunJob
from waam_node.files import write_atomically
from waam_process.grid import GridSpec, HeightGrid
from waam_process.materials import get
from waam_process.segment import Clamp, Kind, Segment
from waam_process.unrolled import Unrolled


def test_all_problems_are_said_at_once(tmp_path):
    goal = JobGoal(
        tmp_path / 'none.stl', 'unobtainium', tmp_path, loop_mode='loop', layer_height=9e-3
    )
    with pytest.raises(JobError) as e:
        check(goal)
    for word in ('none.stl', 'unobtainium', 'loop', 'layer height', '9 mm'):
        assert word in str(e.value)
    assert e.value.code == Code.BAD_GOAL


@pytest.mark.parametrize(
    'field,value', [('k_gain', 0.9), ('tolerance', 1.0), ('scale', -1.0), ('notes', ('x',))]
)
def test_goal_fields_have_limits(tmp_path, parts, field, value):
    goal = JobGoal(parts[0], 'er70s-6', tmp_path, **{field: value})
    with pytest.raises(JobError, match='x' if field == 'notes' else field):
        check(goal)


def test_the_overlap_of_the_material_is_the_pitch_of_the_plan(tmp_path, parts):
    """Not the planner's own default, which is that of the packaged materials; the operator has the last word."""
    material = replace(get('er70s-6'), overlap=0.6)
    goal = JobGoal(parts[0], 'er70s-6', tmp_path)
    assert planner_fields(goal, material)['pitch_ratio'] == 0.6
    told = replace(goal, plan_settings=('pitch_ratio=0.7',))
    assert planner_fields(told, material)['pitch_ratio'] == 0.7


def test_an_error_of_a_job_comes_out_of_a_worker_with_its_code():
    first = next(iter(Code))
    again = pickle.loads(pickle.dumps(JobError(first, 'part: no such file')))
    assert (again.code, str(again)) == (first, 'part: no such file')


def test_two_jobs_in_one_second_get_two_folders(tmp_path):
    a, b = (JobFolder.create(tmp_path, 'same name!') for _ in range(2))
    assert a.path != b.path and ' ' not in a.path.name
    assert (tmp_path / 'latest').resolve() == b.path.resolve()


def test_a_folder_that_goes_with_its_job_keeps_no_track(tmp_path):
    folder = JobFolder.create(tmp_path, 'x')
    track = {'t': np.arange(3.0)}
    replace(folder, passing=True).write_track(1, 1, track)
    assert not (folder.path / 'track').exists()
    replace(folder, passing=True).join_tracks()
    assert not (folder.path / 'telemetry.npz').exists()
    folder.write_track(1, 1, track)
    folder.join_tracks()
    assert (folder.path / 'telemetry.npz').exists()


def test_json_has_no_nan(tmp_path):
    folder = JobFolder.create(tmp_path, 'x')
    folder.write_json('a.json', {'v': [math.nan, np.float32(1.5)], 't': (1, np.int64(2))})
    assert json.loads((folder.path / 'a.json').read_text()) == {'v': [None, 1.5], 't': [1, 2]}
    assert clean(math.inf) is None


def test_atomic_write_leaves_the_old_file_when_it_fails(tmp_path):
    file = tmp_path / 'a.json'
    write_atomically(file, 'old')
    with pytest.raises(TypeError):
        write_atomically(file, 5)
    assert file.read_text() == 'old'


def test_unseen_cells_count_against_the_verdict():
    error = np.full((10, 10), 1e-4)
    error[:2] = np.nan
    everywhere = np.ones((10, 10), bool)
    d = deviation(error, everywhere, everywhere, 2e-4)
    assert d.share_in_tolerance == pytest.approx(0.8) and d.coverage == pytest.approx(0.8)
    assert d.rms == pytest.approx(1e-4)


def test_torch_follows_the_surface_and_the_chain_holds():
    spec = GridSpec(0, 0, 1e-3, 20, 20)
    surface = HeightGrid(spec, np.full(spec.shape, 5e-3))
    down = Segment(0, Kind.IDLE, (0.01, 0.01, 0.03), (0.01, 0.01, 4e-3), 0.05)
    bead = Segment(1, Kind.DEPOSIT, (0.01, 0.01, 4e-3), (0.012, 0.01, 4e-3), 0.01, arc=True)
    up = Segment(2, Kind.IDLE, (0.012, 0.01, 4e-3), (0.012, 0.01, 0.03), 0.05)
    a, b, c = follow([down, bead, up], surface, 1e-3)
    assert a.start == down.start and c.end == up.end
    assert a.end == b.start and b.end == c.start
    assert b.start[2] == pytest.approx(5e-3) and b.end[2] == pytest.approx(5e-3)


def test_the_torch_follows_the_surface_of_a_shaft_in_every_turn():
    shaft = Unrolled(0.040)
    spec = GridSpec(0, 0, 1e-3, 20, round(shaft.length_x / 1e-3))
    z = 10e-3 + 0.5e-3 * np.cos(shaft.angle(spec.x)) * np.ones((20, 1))
    x = [0.05 + turns * shaft.period for turns in range(3)]
    ends = [((v, 0.01, 10e-3), (v + 2e-3, 0.01, 10e-3)) for v in x]
    beads = [Segment(k, Kind.DEPOSIT, a, b, 0.01, arc=True) for k, (a, b) in enumerate(ends)]
    moved = follow(beads, HeightGrid(spec, z), 1e-3, shaft)
    assert [s.start[:2] for s in moved] == [s.start[:2] for s in beads]
    wanted = 10e-3 + 0.5e-3 * np.cos(shaft.angle(0.05))
    assert [s.start[2] for s in moved] == pytest.approx([wanted] * 3, abs=1e-5)


def test_the_floor_beside_a_thin_wall_does_not_draw_the_torch_down():
    spec = GridSpec(0, 0, 0.5e-3, 40, 40)
    z = np.zeros(spec.shape)
    z[17:24] = 21e-3  # 3.5 mm wide, 1 mm above what was planned
    bead = Segment(1, Kind.DEPOSIT, (5e-3, 10e-3, 20e-3), (7e-3, 10e-3, 20e-3), 0.01, arc=True)
    (moved,) = follow([bead], HeightGrid(spec, z), 3e-3)
    assert moved.start[2] == pytest.approx(21e-3) and moved.end[2] == pytest.approx(21e-3)


def test_torch_keeps_its_planned_height_over_unknown_ground():
    spec = GridSpec(0, 0, 1e-3, 20, 20)
    bead = Segment(1, Kind.DEPOSIT, (0.01, 0.01, 4e-3), (0.012, 0.01, 4e-3), 0.01, arc=True)
    assert follow([bead], HeightGrid.full(spec), 1e-3) == [bead]


@given(st.floats(-1, 1), st.floats(0.0, 0.3), st.floats(0.5e-3, 4e-3))
def test_asked_growth_rises_where_the_torch_is_slower(psi, k_gain, planned):
    growth = asked_growth(np.array([planned, 0.0]), np.array([psi, psi]), k_gain, np.zeros(2))
    assert growth[1] == 0
    assert growth[0] * (1 + k_gain * psi) == pytest.approx(planned)


def bead(x, **changes):
    """A segment along y at x, fed as it was planned but for the factors of its layer."""
    values = {
        'index': 1,
        'kind': Kind.DEPOSIT,
        'start': (x, 0.0, 0.0),
        'end': (x, 4e-3, 0.0),
        'speed': 0.01,
        'speed_programmed': 0.01,
        'wire_feed_base': 0.05,
        'wire_feed_speed': 0.05 * 1.1 * 0.96,
        'flow_factor': 1.1,
        'heat_factor': 0.96,
        'width': 6e-3,
    }
    return Segment(**(values | changes))


def test_metal_that_limits_do_not_let_away_counts_as_laid():
    spec = GridSpec(-2e-3, 0.0, 1e-3, 4, 14)
    planned = np.where(np.arange(14) < 12, 1e-3, 0.0) * np.ones((4, 1))
    asked = 0.2 * planned
    floor = bead(0.0, speed=0.02, clamps=Clamp.FEED_LOW | Clamp.SPEED_HIGH)
    free = bead(8e-3, clamps=Clamp.PSI)
    assert driven_growth(asked, planned, spec, [free, free]) is asked
    driven = driven_growth(asked, planned, spec, [floor, free])
    assert driven[:, :6] == pytest.approx(
        0.5e-3
    )  # half of the plan per mm, not the fifth that was asked for
    assert driven[:, 7:] == pytest.approx(asked[:, 7:])
    assert not driven[:, 12:].any()


def frame(stats, n, **changes):
    values = {
        'current': 180.0,
        'voltage': 22.0,
        'wire': 0.08,
        'wire_commanded': 0.08,
        'speed': 0.01,
        'arc': True,
    }
    stats.add(n, 10_000 * n, n * 0.01, (0.0, 0.0, 0.0), **{**values, **changes})


def test_sums_count_lost_frames_arc_starts_and_energy():
    stats = TelemetryStats()
    for n in [1, 2, 3, 4, 8, 9]:
        frame(stats, n)
    frame(stats, 10, arc=False, current=0.0)
    frame(stats, 11)
    s = stats.take_sums()
    assert (
        s.lost == 3
        and s.arc_starts == 2
        and s.arc_frames == 7
        and s.frame_period == pytest.approx(0.01)
    )
    assert s.power_per_speed / s.arc_frames == pytest.approx(180 * 22 / 0.01)
    assert stats.take_sums().frames == 0


def cost_of(current, error=0.0, frames=100):
    """Cost of a layer whose arc burns at `current` A for frames of 10 ms, after `error` m of height."""
    stats, steel = TelemetryStats(), get('er70s-6')
    for n in range(frames):
        frame(stats, n, current=current, wire_commanded=steel.arc_current_feed)
    record = LayerRecord(height_error_rms=error)
    record.add_sums(stats.take_sums(), steel.set_current)
    record.add_height_cost(0.0)
    return record.cost


def test_cost_shows_a_current_that_is_steadily_off_what_was_set():
    """138 A are set at 6.6 m/min: 20 A off for a second cost 1e-4*20^2, in either direction."""
    assert cost_of(138.0) == pytest.approx(0.0, abs=1e-9)
    assert cost_of(158.0) == pytest.approx(0.04, rel=0.02)
    assert cost_of(118.0) == pytest.approx(0.04, rel=0.02)


def test_cost_of_a_material_without_set_current_counts_heights_only():
    stats, aluminium = TelemetryStats(), get('er4043')
    for n in range(100):
        frame(stats, n, current=190.0)
    record = LayerRecord()
    record.add_sums(stats.take_sums(), aluminium.set_current)
    assert record.current_mean == pytest.approx(190.0) and record.cost == 0.0


def test_cost_counts_the_final_surface():
    """Half a second of arc on each side of a surface; the last one has only the layer before."""
    final = LayerRecord(final=True, height_error_rms=0.5e-3)
    final.add_height_cost(1.0)
    assert final.cost == pytest.approx(0.5**2 * 0.5)
    assert cost_of(138.0, error=0.5e-3) == pytest.approx(0.5**2 * 0.5, rel=0.02)


def test_the_track_says_to_a_frame_when_the_arc_changed():
    """Rows come every tenth frame; the length of a bead must be known better."""
    stats = TelemetryStats()
    for n in range(1, 41):
        frame(stats, n, arc=13 <= n < 36)
    track = stats.take_track()
    np.testing.assert_allclose(track['t'], [0.1, 0.2, 0.3, 0.4])
    np.testing.assert_allclose(track['arc_changed'], [np.nan, 0.13, np.nan, 0.36])
    np.testing.assert_allclose(track['arc'], [0, 1, 1, 0])


def test_sequence_wraps_without_a_loss():
    stats = TelemetryStats()
    frame(stats, 0xFFFFFFFF)
    frame(stats, 0)
    assert stats.take_sums().lost == 0


def test_settings_of_the_planner_are_checked_with_the_goal(tmp_path, parts):
    wrong = ('speed=fast', 'layer_height=0.001', 'nonsense=1', 'edge_metal=9')
    with pytest.raises(JobError) as e:
        check(JobGoal(parts[0], 'er70s-6', tmp_path, loop_mode='loop', plan_settings=wrong))
    for word in (
        'loop',
        "'fast'",
        'layer_height is given by',
        'no setting nonsense',
        '1.5',
        'known:',
    ):
        assert word in str(e.value), word
    with pytest.raises(JobError, match='speed_max is 0.005, below speed 0.01'):
        check(JobGoal(parts[0], 'er70s-6', tmp_path, plan_settings=('speed_max=0.005',)))


def write_3mf(file: Path, mesh: trimesh.Trimesh) -> None:
    """mesh in mm; trimesh writes this kind only with a library that is not installed."""
    corners = ''.join(f'<vertex x="{x}" y="{y}" z="{z}"/>' for x, y, z in mesh.vertices)
    faces = ''.join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in mesh.faces)
    space = 'http://schemas.microsoft.com/3dmanufacturing/core/2015/02'
    text = (
        f'<model unit="millimeter" xmlns="{space}"><resources><object id="1" type="model"><mesh>'
        f'<vertices>{corners}</vertices><triangles>{faces}</triangles></mesh></object></resources>'
        '<build><item objectid="1"/></build></model>'
    )
    with zipfile.ZipFile(file, 'w') as z:
        z.writestr('3D/3dmodel.model', text)


@pytest.mark.parametrize('kind', ['stl', 'ply', '3mf', 'obj', 'off'])
def test_every_kind_of_mesh_is_a_part(tmp_path, kind):
    file = tmp_path / f'box.{kind}'
    box = trimesh.creation.box(extents=(30, 20, 10))
    box.export(file) if kind != '3mf' else write_3mf(file, box)
    part = check(JobGoal(file, 'er70s-6', tmp_path, mode='build')).part
    assert part.bounds[1] - part.bounds[0] == pytest.approx([0.03, 0.02, 0.01])
    text = (Path(__file__).parents[2] / 'waam_msgs' / 'action' / 'RunJob.action').read_text()
    assert kind.upper() in next(
        line for line in text.splitlines() if line.startswith('string part ')
    )


def test_an_open_mesh_is_a_part_of_a_shell_or_when_it_is_repaired(tmp_path):
    box = trimesh.creation.box(extents=(30, 20, 10))
    file = tmp_path / 'open.stl'
    trimesh.Trimesh(box.vertices, box.faces[1:]).export(file)
    fields = {'part': file, 'material': 'er70s-6', 'jobs_dir': tmp_path, 'mode': 'build'}
    with pytest.raises(JobError, match='open mesh'):
        check(JobGoal(**fields))
    assert not check(JobGoal(**fields, strategy='shell')).part.report.closed
    repaired = check(JobGoal(**fields, repair=True)).part.report
    assert repaired.closed and 'hole of 3 edges' in repaired.repairs[0]


def test_goal_goes_through_message_and_job_file(tmp_path, parts):
    sent = RunJob.Goal(
        part=str(parts[0]), passes=2, k_gain=math.nan, wire_left=50.0, repair=True,
        plan_settings=['edge_metal=1.2', 'alternation=turn'],
    )  # fmt: skip
    goal = goal_from_msg(sent, tmp_path)
    assert goal.plan_settings == ('edge_metal=1.2', 'alternation=turn') and goal.repair
    folder = new_folder(goal, check(goal), {})
    same = goal_from_job(folder.read_yaml('job.yaml'), RunJob.Goal())
    assert same.plan_settings == goal.plan_settings and same.repair and not same.new_spool
    assert same.wire_left == 50.0 and math.isnan(same.k_gain)
    assert same.learned_dir == tmp_path / 'learned' and not same.fresh
    spool = goal_from_job(folder.read_yaml('job.yaml'), RunJob.Goal(wire_left=80.0))
    assert spool.wire_left == 80.0 and spool.new_spool
    old = folder.read_yaml('job.yaml')
    for name in ('plan_settings', 'repair', 'new_spool', 'learned_dir', 'fresh'):
        del old['goal'][name]  # of a job that began before there were any
    old['goal']['profile'] = old['goal'].pop('loop_mode').replace('closed_loop', 'monitor')
    assert goal_from_job(old, RunJob.Goal()).plan_settings == ()
    assert goal_from_job(old, RunJob.Goal()).learned_dir is None
    assert goal_from_job(old, RunJob.Goal()).loop_mode == 'monitor'  # by its old name


def test_layers_that_were_recorded_before_the_loop_mode_had_its_name_are_read():
    data = asdict(LayerRecord('job', 'open_loop', 3, wire_used=0.5))
    data['profile'] = data.pop('loop_mode')
    assert LayerRecord.from_json(data).loop_mode == 'open_loop'


def test_layers_that_were_corrected_while_they_were_laid_are_read():
    """By an older version; any other name that is not known stays an error."""
    data = asdict(LayerRecord('job', 'closed_loop', 3, wire_used=0.5))
    old = data | {'in_layer_looks': 4, 'in_layer_corrections': 2, 'in_layer_change': None}
    assert asdict(LayerRecord.from_json(old)) == asdict(LayerRecord.from_json(data))
    with pytest.raises(TypeError, match='in_layers'):
        LayerRecord.from_json(data | {'in_layers': 1})


def test_the_limit_of_k_gain_is_the_same_everywhere():
    interfaces = Path(__file__).parents[2] / 'waam_msgs'
    for file, field in (
        ('action/RunJob.action', 'float64 k_gain'),
        ('srv/AdjustJob.srv', 'uint8 SET_K_GAIN'),
    ):
        line = next(x for x in (interfaces / file).read_text().splitlines() if x.startswith(field))
        assert f'0..{K_GAIN_MAX:g}' in line


def test_beads_that_were_laid_are_told_with_the_width_that_the_table_expects():
    steel = get('er70s-6')
    feed, speed, volts = steel.wire_feed, steel.speed, steel.voltage

    def bead(i, a, b, **more):
        return Segment(i, Kind.DEPOSIT, (*a, 0.0), (*b, 0.0), speed, arc=True, **more)

    first = bead(0, (0, 0), (0.02, 0), wire_feed_speed=feed, voltage=volts, width=5e-3)
    second = bead(1, (0.02, 0), (0.02, 0.02), wire_feed_speed=feed, voltage=1.3 * volts)
    away = Segment(2, Kind.IDLE, (0.02, 0.02, 0), (0, 0.05, 0), 0.05)
    third = bead(3, (0, 0.05), (0.01, 0.05), width=4e-3)  # without setpoints: as planned
    laid = laid_beads([first, second, away, third], steel)
    assert [p.tolist() for p in laid.paths] == [
        [[0, 0], [0.02, 0], [0.02, 0.02]], [[0, 0.05], [0.01, 0.05]],
    ]  # fmt: skip
    assert laid.widths[0] == pytest.approx([6e-3, 6e-3, 6e-3 * 1.3**0.4])
    assert laid.widths[1] == pytest.approx([4e-3, 4e-3])
    request = begin_request('job', 3, GridSpec(0, 0, 1e-3, 20, 20), laid)
    assert list(request.laid.points) == [3, 2] and len(request.laid_width) == 5
    assert laid_beads([away], steel).paths == ()


def test_the_width_of_a_scan_stands_in_the_record_and_goes_to_the_correction_also_from_the_folder():
    spec = GridSpec(0, 0, 1e-3, 4, 5)
    scan = Scan(
        HeightGrid.full(spec, 0.0), np.ones(spec.shape, np.uint16), 1.0, True,
        bead_width=6.4e-3, bead_width_u=0.1e-3, bead_width_expected=6.1e-3,
    )  # fmt: skip
    record = LayerRecord()
    record.add_scan(scan)
    assert (record.bead_width, record.bead_width_u, record.bead_width_expected) == (
        6.4e-3, 0.1e-3, 6.1e-3,
    )  # fmt: skip
    again = scan_from_msg(scan_to_msg(scan, 'job', 1, Time()))
    assert again.bead_width == pytest.approx(6.4e-3) and again.bead_width_u == pytest.approx(1e-4)
