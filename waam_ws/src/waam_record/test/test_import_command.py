"""`waam record import`: nothing is written before a mapping is given, and then what the log says comes out."""

import argparse
import math
from pathlib import Path

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from waam_node import cdr
from waam_record import cli, import_command
from waam_record.bag_copy import messages as bag_messages
from waam_record.bag_reader import check, info
from waam_record.foreign.mapping import read_mapping

LOG = (
    'Machine of somebody\r\n\r\n'
    't;x [mm];Strom;U;WFS (m/min);temp_C;remark;q\r'
    '59:59,9;440,0;120,5;14,25;6,0;;start;1\n'
    '00:00,0;439,0;121,5;14,5;6,0;300,5;;2\r\n'
    '\n'
    '00:00,0;438,0;oops;14,5;6,0;301;;2\r'
    '00:00,1;437,0;2,5\n'
    'soon;436,0;2,5;0;0;0;;0\n'
)
MM = 1e-3


def run(*words):
    parser = argparse.ArgumentParser()
    cli.register(parser.add_subparsers())
    args = parser.parse_args(['record', *map(str, words)])
    return args.run_command(args)


@pytest.fixture
def log(tmp_path):
    path = tmp_path / 'weld.csv'
    path.write_bytes(LOG.encode())
    return path


def messages(path: Path):
    """topic -> (stamp, bytes)."""
    found = {}
    for topic, message in bag_messages([path]):
        found.setdefault(topic.name, []).append((message.log_time, message.data))
    return found


def test_without_a_mapping_one_is_proposed_and_nothing_written(log, tmp_path, capsys):
    out = tmp_path / 'out.mcap'
    assert run('import', log, '-o', out) == import_command.PROPOSED
    said = capsys.readouterr()
    assert not out.exists() and 'nothing was written' in said.err
    one = read_mapping(said.out, 'm')['weld.csv']
    assert (one.form.delimiter, one.form.decimal, one.form.header_line) == (';', ',', 3)
    assert one.time.form == 'minute_second'
    roles = {name: (c.role, c.unit) for name, c in one.columns.items()}
    assert roles['x [mm]'] == ('position_x', 'mm') and roles['WFS (m/min)'] == (
        'wire_feed_speed',
        'm/min',
    )
    assert roles['temp_C'] == ('temperature', 'C') and roles['q'] == ('number', '')
    assert 'not understood: remark, q' in said.err
    lines = {line.split(':')[0].strip(): line for line in said.out.splitlines()}
    assert 'GUESSED' in lines['Strom'] and 'GUESSED' not in lines['x [mm]']


def test_the_mapping_makes_topics_of_this_software(log, tmp_path, capsys):
    run('import', log)
    text = capsys.readouterr().out.replace('2000-01-01T00:00:00Z', '2026-01-31T16:00:00Z')
    (tmp_path / 'mapping.yaml').write_text(text)
    out = tmp_path / 'out.mcap'
    assert run('import', log, '--mapping', tmp_path / 'mapping.yaml', '-o', out) == 0
    said = capsys.readouterr().out
    for word in (
        '3 of 5 rows', '1 rows left out: time is not minute:second (line 9)', 'not a number (line 7)',
        '1 lines left out: 3 cells, the header has 8 (line 8)', 'not imported: remark (3 rows each)',
        '1 rows have no temp_C (line 4)',
    ):  # fmt: skip
        assert word in said, said
    found = messages(out)
    stamps, frames = cdr.read_frames([data for _, data in found['/telemetry']])
    hour = 1769875200 * 10**9  # 31 January 2026, 16:00
    assert stamps.tolist() == [
        hour + 3_599_900_000_000,
        hour + 3_600_000_000_000,
        hour + 3_600_050_000_000,
    ]
    assert frames['x'].tolist() == pytest.approx([0.440, 0.439, 0.438])
    assert np.isnan(frames['y']).all(), 'what the log does not say is not a number'
    assert frames['arc_current'][:2].tolist() == [120.5, 121.5] and math.isnan(
        frames['arc_current'][2]
    )
    assert frames['arc_established'].tolist() == [True, True, False]
    assert frames['wire_feed_speed'][0] == pytest.approx(0.1)
    assert len(found['/temperature']) == 2 and len(found['/weld/q']) == 3
    assert check(out).sound and info(out).topics['/telemetry'].type == 'waam_msgs/msg/Telemetry'


def test_yes_takes_the_proposal_and_a_folder_is_a_ros_bag(log, tmp_path, capsys):
    assert run('import', log, '--yes', '-o', tmp_path / 'bag') == 0
    with AnyReader([tmp_path / 'bag']) as reader:
        kinds = {c.topic: c.msgtype for c in reader.connections}
    assert kinds['/temperature'] == 'sensor_msgs/msg/Temperature'
    assert run('import', log, '--yes', '-o', tmp_path / 'bag') == 1
    assert 'never overwritten' in capsys.readouterr().err


def change(text, old, new):
    assert old in text
    return text.replace(old, new)


@pytest.mark.parametrize(
    ('old', 'new', 'words'),
    [
        ('is: arc_voltage', 'is: volts', ['weld.csv: columns: U: is', 'arc_voltage']),
        ('unit: V', 'unit: A', ["unit 'A' is none of V, mV"]),
        ('format: minute_second', 'format: hours', ['time: format', 'minute_second']),
        ('      q: {is: number}', '      z9: {is: number}', ["column 'z9'", 'weld.csv']),
        ('      q: {is: number}', '', ["nothing of column 'q'"]),
        ('q: {is: number}', 'q: {is: arc_voltage, unit: V}', ['U and q are both arc_voltage']),
        ('delimiter: ;', "delimiter: ','", ['cannot both be a comma']),
        ('weld.csv:', 'other.csv:', ['nothing about weld.csv']),
        ('waam_import: 1', 'waam_import: 2', ['waam_import must be 1']),
        ('offset_s: 0', 'offset_s: soon', ['offset_s', 'soon']),
        ('    columns:', '    colums:', ['unknown entry', 'colums']),
        ('header_line: 3', 'header_line: 900', ['header_line is 900']),
    ],
)
def test_a_wrong_mapping_is_refused_by_name(log, tmp_path, capsys, old, new, words):
    run('import', log)
    (tmp_path / 'mapping.yaml').write_text(change(capsys.readouterr().out, old, new))
    assert (
        run('import', log, '--mapping', tmp_path / 'mapping.yaml', '-o', tmp_path / 'o.mcap') == 1
    )
    err = capsys.readouterr().err
    assert len(err.splitlines()) == 1
    for word in words:
        assert word in err, err
    assert not (tmp_path / 'o.mcap').exists() and not list(tmp_path.glob('.import*'))


def test_profiles_without_poses_take_rate_direction_and_speed_of_the_mapping(tmp_path, capsys):
    path = tmp_path / 'scan.csv'
    rows = ['X,Z'] + [
        f'{" ".join(map(str, range(5)))},{" ".join([str(100 + k)] * 5)}' for k in range(4)
    ]
    rows += ['1 2 3,100 100', '1,100', 'nan nan,100 100']
    path.write_text('\n'.join(rows))
    run('import', path)
    text = capsys.readouterr().out
    text = change(
        change(text, 'rate_hz: 1 ', 'rate_hz: 10 '),
        "direction: '+x', speed_mm_s: 10",
        "direction: '-y', speed_mm_s: 20",
    )
    (tmp_path / 'm.yaml').write_text(text)
    assert run('import', path, '--mapping', tmp_path / 'm.yaml', '-o', tmp_path / 'o.mcap') == 0
    said = capsys.readouterr().out
    assert (
        'lists of different lengths (line 6)' in said
        and '1 point (line 7)' in said
        and 'no points (line 8)' in said
    )
    found = messages(tmp_path / 'o.mcap')
    _, frames = cdr.read_frames([data for _, data in found['/telemetry']])
    assert frames['y'][:4].tolist() == pytest.approx([0, -2 * MM, -4 * MM, -6 * MM])
    batches = [cdr.read_batch(data) for _, data in found['/profiles']]
    assert [float(b.z[0]) for b in batches] == pytest.approx([-0.1, -0.101, -0.102, -0.103])
    assert batches[1].stamp_ns - batches[0].stamp_ns == 100_000_000


def test_two_logs_of_one_run(tmp_path, capsys):
    arc, scan = tmp_path / 'arc.csv', tmp_path / 'scan.csv'
    arc.write_text('time,x,y,z\n36:51.1,1,2,3\n36:51.2,2,2,3\n36:51.3,20,2,3\n')
    scan.write_text(
        'TimeReceived,X,Z\n'
        + ''.join(f'2025-04-15 17:36:5{k}.5,1 2 3,99 99 99\n' for k in (1, 2, 3))
    )
    assert run('import', arc, scan, '--yes', '-o', tmp_path / 'o.mcap') == 0
    said = capsys.readouterr().out
    assert 'start: 2025-04-15T17:00:00Z  # GUESSED: from scan.csv' in said and 'travel' not in said
    assert set(messages(tmp_path / 'o.mcap')) == {'/telemetry', '/profiles'}
    other = tmp_path / 'again.csv'
    other.write_text(arc.read_text())
    assert run('import', arc, other, '--yes', '-o', tmp_path / 'p.mcap') == 1
    assert '/telemetry comes from' in capsys.readouterr().err


@pytest.mark.parametrize(
    ('first', 'scanned', 'start'),
    [
        ('59:58.0', '18:00:05', '17:00:00'),
        ('00:03.0', '17:59:50', '18:00:00'),
        ('20:00.0', '18:21:00', '18:00:00'),
    ],
)
def test_minutes_take_the_hour_that_brings_two_logs_together(
    tmp_path, capsys, first, scanned, start
):
    arc, scan = tmp_path / 'arc.csv', tmp_path / 'scan.csv'
    arc.write_text(f'time,x,y,z\n{first},1,2,3\n{first},2,2,3\n')
    scan.write_text(f'TimeReceived,X,Z\n2025-04-15 {scanned},1 2 3,99 99 99\n' * 2)
    run('import', arc, scan)
    assert f'start: 2025-04-15T{start}Z  # GUESSED: from scan.csv' in capsys.readouterr().out


def test_ros_exports_keep_the_stamps_of_their_messages(tmp_path, capsys):
    path = tmp_path / 'temperature.csv'
    path.write_text(
        "rosbagTimestamp,secs,nsecs,frame_id,temperature\n"
        "1666985301185212971,1666985301,177676916,'',180.5\n"
    )
    assert run('import', path, '--yes', '-o', tmp_path / 'o') == 0
    with AnyReader([tmp_path / 'o']) as reader:
        ((c, stamp, raw),) = list(reader.messages())
        message = reader.deserialize(raw, c.msgtype)
    assert stamp == 1666985301177676916 and message.temperature == 180.5


def test_help_teaches(capsys):
    with pytest.raises(SystemExit):
        run('import', '--help')
    said = capsys.readouterr().out
    for word in (
        '--mapping',
        'minute_second',
        'GUESSED',
        'profile_distance',
        'm/min',
        'exit status',
    ):
        assert word in said
