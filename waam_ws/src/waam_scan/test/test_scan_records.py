"""`waam scan fuse` and `calibrate` on recorded jobs: what the recorder writes becomes maps and a calibration."""

import json
from array import array

import numpy as np
import pytest
from rclpy.serialization import serialize_message
from scan_cli import run

from waam_msgs.msg import ProfileBatch, Telemetry
from waam_node.conversions import floats
from waam_record.bag_writer import BagWriter, Topic
from waam_record.definitions import ament_prefixes, full_text
from waam_scan.calibration.scan_pass import Pass
from waam_scan.map_file import FileError, load_map
from waam_scan.scan_records import passes, recorded_mounting

START = 1_700_000_000_000_000_000
KINDS = {'/telemetry': 'waam_msgs/msg/Telemetry', '/profiles': 'waam_msgs/msg/ProfileBatch'}
PARAMETERS = {
    'calibration': '',
    'mount_xyz': [0.05, 0.0, 0.1],
    'mount_rpy': [0.0, 0.0, np.pi / 2],
    'profile_delay': 0.0,
}


def stamp(header, ns):
    header.stamp.sec, header.stamp.nanosec = divmod(int(ns), 1_000_000_000)


def telemetry(ns, xyz):
    msg = Telemetry()
    msg.header.frame_id = 'work'
    stamp(msg.header, ns)
    msg.position.x, msg.position.y, msg.position.z = map(float, xyz)
    return msg


def batch(number, stamps, x, z):
    msg = ProfileBatch(
        sequence=number, profile_count=len(stamps), points_per_profile=x.shape[1], sensor_id='s'
    )
    stamp(msg.header, stamps[0])
    msg.stamp_offsets_ns = array('q', (stamps - stamps[0]).tolist())
    msg.x, msg.z = floats(x), floats(z)
    return msg


def record(path, scans, parameters=PARAMETERS, change=lambda text: text):
    """A recording of passes, in batches of ten profiles among the telemetry, as the recorder would write it."""
    custom = {} if parameters is None else {'parameters.scan_fusion': json.dumps(parameters)}
    writer = BagWriter(path, custom)
    topics = {
        name: writer.add_topic(Topic(name, kind, change(full_text(kind, ament_prefixes()))))
        for name, kind in KINDS.items()
    }
    number = 0
    for p in scans:
        events = [
            (t, '/telemetry', telemetry(t, xyz))
            for t, xyz in zip(p.pose_stamps, p.poses, strict=True)
        ]
        for k in range(0, len(p.stamps), 10):
            s = slice(k, k + 10)
            message = batch(number, p.stamps[s], p.x[s], p.z[s])
            events.append((p.stamps[s][-1], '/profiles', message))
            number += 1
        for t, topic, msg in sorted(events, key=lambda e: e[0]):
            writer.write(topics[topic], int(t), int(t), 1, serialize_message(msg))
    writer.close()
    return writer.files[0]


def layer(k, tilt=0.1, points=60):
    """A pass of 3 s over a slope k mm above the table, with the mounting of PARAMETERS; ten seconds per layer."""
    rng = np.random.default_rng(k)
    began = START + k * 10_000_000_000
    t = np.arange(0, 3.0, 0.01)
    poses = np.column_stack([0.01 * t - 0.05, np.full(len(t), 0.01), np.full(len(t), 0.03)])
    when = np.arange(0.5, 2.5, 0.01)
    x = np.tile(np.linspace(-8e-3, 8e-3, points), (len(when), 1))
    surface = k * 1e-3 + tilt * (0.01 * when)[:, None] + 0 * x
    z = surface + rng.normal(0, 10e-6, x.shape) - 0.13
    return Pass(
        began + np.round(when * 1e9).astype(np.int64), x, z,
        began + np.round(t * 1e9).astype(np.int64), poses,
    )  # fmt: skip


def test_every_scan_of_a_job_gives_a_map_with_the_mounting_of_the_job(tmp_path, capsys):
    record(tmp_path / 'job' / 'record', [layer(0), layer(1)])
    record(tmp_path / 'job' / 'record_2', [layer(2)])  # the job was resumed
    assert run('fuse', tmp_path / 'job', '--cell', 0.5, '--out', tmp_path / 'maps') == 0
    said = capsys.readouterr().out
    assert said.count('200 profiles used, 0 rejected') == 3
    for k in range(3):
        grid = load_map(tmp_path / 'maps' / f'scan_{k:03}.npz')
        x = np.broadcast_to(grid.spec.x, grid.spec.shape)
        inside = (x > 6e-3) & (x < 24e-3)
        error = (grid.z - k * 1e-3 - 0.1 * x)[inside]
        assert abs(np.nanmedian(error)) < 5e-6 and np.isfinite(error).mean() > 0.9
        assert (tmp_path / 'maps' / f'scan_{k:03}.png').stat().st_size > 5_000
    assert not (tmp_path / 'maps' / 'scan_003.npz').exists()


def test_a_folder_of_a_record_and_its_file_give_the_same_passes(tmp_path):
    file = record(tmp_path / 'record', [layer(0), layer(1)])
    for path in (tmp_path, tmp_path / 'record', file):
        found = list(passes(path))
        assert [len(p.stamps) for p in found] == [200, 200]
        for p, k in zip(found, (0, 1), strict=True):
            want = layer(k)
            assert (p.stamps == want.stamps).all()
            assert p.x.tobytes() == want.x.astype(np.float32).tobytes()
            near = np.isin(want.pose_stamps, p.pose_stamps)
            assert near.sum() == len(p.pose_stamps) > 250
            assert (p.poses == want.poses[near]).all()


def test_batches_out_of_order_and_of_other_widths_make_one_pass(tmp_path):
    a, wide = layer(0), layer(0, points=80)
    late = Pass(
        np.concatenate([a.stamps[100:], wide.stamps[:100]]),
        np.full((200, 1), 0.0), np.full((200, 1), -0.1), a.pose_stamps, a.poses,
    )  # fmt: skip
    record(tmp_path / 'record', [late])
    (found,) = passes(tmp_path)
    assert (np.diff(found.stamps) > 0).all() and len(found.stamps) == 200
    record(tmp_path / 'mixed' / 'record', [layer(0, points=1), layer(1, points=80)])
    (both,) = passes(tmp_path / 'mixed', pause=100.0)
    assert both.x.shape == (400, 80)
    assert np.isfinite(both.x[:200]).sum() == 200 and np.isfinite(both.x[200:]).all()


def test_a_record_that_was_cut_off_gives_what_is_left(tmp_path):
    file = record(tmp_path / 'record', [layer(0), layer(1)])
    whole = file.read_bytes()
    (tmp_path / 'cut.mcap').write_bytes(whole[: len(whole) * 2 // 3])
    found = list(passes(tmp_path / 'cut.mcap'))
    assert found and (found[0].stamps == layer(0).stamps[: len(found[0].stamps)]).all()


@pytest.mark.parametrize(
    'scans, change, text',
    [
        ([], str, 'no profile in it (its scanner was never on)'),
        ([layer(0)], lambda t: t.replace('int64[] stamp', 'uint64[] stamp'), 'with other fields'),
    ],
)
def test_records_that_hold_no_scan_are_refused_with_the_reason(
    tmp_path, capsys, scans, change, text
):
    record(tmp_path / 'record', scans, change=change)
    assert run('fuse', tmp_path, '--out', tmp_path / 'maps') == 1
    error = capsys.readouterr().err
    assert text in error and error.count('\n') == 1
    (tmp_path / 'dust.mcap').write_bytes(b'dust')
    assert run('fuse', tmp_path / 'dust.mcap', '--mount', 0, 0, 0, 0, 0, 90) == 1
    assert 'not an MCAP file' in capsys.readouterr().err


def test_a_scan_without_telemetry_is_refused(tmp_path):
    p = layer(0)
    late = Pass(p.stamps + 10**12, p.x, p.z, p.pose_stamps, p.poses)
    record(tmp_path / 'record', [late])
    with pytest.raises(FileError, match='no telemetry around its profiles'):
        list(passes(tmp_path))


def test_a_bad_scan_of_a_job_is_left_out_and_the_others_keep_their_numbers(tmp_path, capsys):
    p = layer(1)
    silent = Pass(p.stamps, p.x, p.z * np.nan, p.pose_stamps, p.poses)
    record(tmp_path / 'record', [layer(0), silent, layer(2)])
    assert run('fuse', tmp_path, '--cell', 0.5, '--out', tmp_path / 'maps') == 0
    notes = capsys.readouterr().err.splitlines()
    assert 'scan 1: not a single return in it' in notes[0] and len(notes) == 2
    made = sorted(f.name for f in (tmp_path / 'maps').glob('*.npz'))
    assert made == ['scan_000.npz', 'scan_002.npz']
    lonely = Pass(p.stamps + 10**13, p.x, p.z, p.pose_stamps, p.poses)
    record(tmp_path / 'late' / 'record', [layer(0), lonely])
    assert run('fuse', tmp_path / 'late', '--cell', 0.5, '--out', tmp_path / 'late_maps') == 0
    assert 'scan 1: no telemetry around its profiles' in capsys.readouterr().err


def test_the_calibration_file_of_a_job_must_be_given(tmp_path, capsys):
    record(tmp_path / 'record', [layer(0)], PARAMETERS | {'calibration': 'monday.yaml'})
    assert run('fuse', tmp_path, '--out', tmp_path / 'maps') == 1
    assert 'monday.yaml: name it with --calibration' in capsys.readouterr().err
    words = ('--mount', 50, 0, 100, 0, 0, 90, '--out', tmp_path / 'maps')
    assert run('fuse', tmp_path, *words) == 0
    record(tmp_path / 'old' / 'record', [layer(0)], None)
    assert np.allclose(recorded_mounting(tmp_path / 'old').offset, [0.060, 0.0, 0.120])


def test_a_recorded_calibration_run_is_the_same_as_its_passes(tmp_path):
    import calibration_sim as sim

    (tmp_path / 'block.yaml').write_text(
        'kind: block\ntop_mm: [20, 14]\nslope_deg: [45, 40]\nheight_mm: 12\n'
        'position_mm: [100, 60, 0]\nposition_sigma_mm: 0.005\nyaw_sigma_deg: 0.005\n'
    )
    slopes = (np.radians(45), np.radians(40))
    world = sim.block_world((0.020, 0.014), 0.012, slopes, (0.1, 0.06, 0.0), 0.0)
    offset, rpy, delay = np.array([0.061, 0.001, 0.119]), (0.01, -0.01, 1.58), 0.012
    rng = np.random.default_rng(0)
    scans = sim.passes_over(world, (0.1, 0.06), offset, rpy, delay, rng, points=80)
    ordered, at = [], START
    for p in scans:  # one after the other, as a machine would
        shift = at - min(p.pose_stamps[0], p.stamps[0])
        moved = Pass(p.stamps + shift, p.x, p.z, p.pose_stamps + shift, p.poses)
        ordered.append(moved)
        at = max(moved.pose_stamps[-1], moved.stamps[-1]) + 3_000_000_000
    record(tmp_path / 'record', ordered, None)
    out = tmp_path / 'calibration.yaml'
    assert run('calibrate', tmp_path / 'block.yaml', tmp_path / 'record', '--out', out) == 0
    from waam_scan.calibration.file import load_calibration

    found = load_calibration(out).mounting
    assert np.abs(found.offset - offset).max() < 20e-6 and abs(found.delay - delay) < 0.5e-3
