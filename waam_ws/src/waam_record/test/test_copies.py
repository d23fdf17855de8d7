"""Reading in order, recover and import: what comes out is what went in, in order, under the same names."""

import argparse
from pathlib import Path

import pytest
from rosbags.highlevel import AnyReader

from waam_node import cdr
from waam_record import cli
from waam_record.bag_copy import messages
from waam_record.bag_reader import bag_files, check, info
from waam_record.bag_writer import BagError, BagWriter, Topic

S = 10**9
DATA = Path(__file__).parents[5] / 'shared/data/arc_logs'
needs_data = pytest.mark.skipif(not DATA.is_dir(), reason=f'no recordings in {DATA}')
TEXT = 'string data\n'


LATCHED = ({'reliability': 'reliable', 'durability': 'transient_local'},)


def payload(i: int) -> bytes:
    text = f'{i:05d}'.encode() + b'\0'
    return b'\0\1\0\0' + len(text).to_bytes(4, 'little') + text + bytes(300)


def write(folder, names, offset=0, type_name='std_msgs/msg/String', qos=(), split_at=()):
    writer = BagWriter(folder, {'from': folder.name})
    numbers = [
        writer.add_topic(
            Topic(n, type_name, TEXT, qos=LATCHED if n == '/held' else qos, latched=n == '/held')
        )
        for n in names
    ]
    for i in range(50):
        t = S * 100 + i * S // 10 + offset
        for number, name in zip(numbers, names, strict=True):
            if name != '/held' or i == 0:
                writer.write(number, t, t - 5, i + 1, payload(i))
        if i in split_at:
            writer.split()
    writer.close()


def test_a_broken_source_is_named(tmp_path):
    write(tmp_path / 'a', ['/x'])
    file = bag_files(tmp_path / 'a')[0]
    file.write_bytes(file.read_bytes()[:2000])
    with pytest.raises(BagError, match='not whole .* waam record recover'):
        list(messages([file]))


def test_unknown_compression_is_refused(tmp_path):
    with pytest.raises(BagError, match="unknown compression 'zip'"):
        BagWriter(tmp_path / 'x', compression='zip')


def run(*argv) -> int:
    parser = argparse.ArgumentParser()
    cli.register(parser.add_subparsers())
    args = parser.parse_args(['record', *map(str, argv)])
    return args.run_command(args)


def test_commands(tmp_path, capsys):
    write(tmp_path / 'a', ['/x', '/y'])
    assert run('info', tmp_path / 'a') == 0 and run('check', tmp_path / 'a') == 0
    assert '100 messages' in capsys.readouterr().out


def test_a_job_folder_stands_for_its_record(tmp_path, capsys):
    write(tmp_path / 'job/record', ['/x'])
    assert run('check', tmp_path / 'job') == 0
    assert '50 messages verified' in capsys.readouterr().out
    assert run('recover', tmp_path / 'job') == 0
    assert check(tmp_path / 'job/record_recovered').messages == 50


def test_a_bag_is_for_another_program(tmp_path, capsys):
    (tmp_path / 'a.bag').write_text('dust')
    assert run('import', tmp_path / 'a.bag', '-o', tmp_path / 'out') == 1
    assert f'rosbags-convert --src {tmp_path}/a.bag' in capsys.readouterr().err


@needs_data
def test_logs_of_the_same_weld(tmp_path):
    names = ('plate25_weld_params.csv', 'pyro_Plate19.dat')
    paths = [DATA / n for n in names]
    assert run('import', *paths, '--yes', '-o', tmp_path / 'out') == 0
    kinds = {n: t.type for n, t in info(tmp_path / 'out').topics.items()}
    assert kinds['/pyro_plate19/tratio'] == 'sensor_msgs/msg/Temperature'
    with AnyReader([tmp_path / 'out']) as reader:
        hot = [
            reader.deserialize(raw, c.msgtype).temperature
            for c, _, raw in reader.messages()
            if c.topic == '/pyro_plate19/tproc'
        ]
    assert 930.8 in hot and min(hot) == 550.0
    frames = [m.data for t, m in messages(bag_files(tmp_path / 'out')) if t.name == '/telemetry']
    stamps, values = cdr.read_frames(frames)
    assert stamps[0] == 1666985301168724060, 'the stamp of the message, not that of its arrival'
    assert abs(values['wire_feed_speed'][0] - 7.7 / 60) < 1e-6
