"""The nodes themselves, as processes, asked again by the player: every map and psi as recorded."""

import argparse
import json

from mcap.records import Channel, Message

from waam_node.testing import fresh_domain
from waam_record.bag_reader import bag_files
from waam_record.read_record import load
from waam_record.salvage import records
from waam_replay import cli
from waam_replay.steps import steps

DOMAIN = fresh_domain()


def play(job, capsys) -> tuple[int, str]:
    parser = argparse.ArgumentParser()
    cli.register(parser.add_subparsers())
    args = parser.parse_args(['replay', 'play', str(job), '--lockstep', '--domain', str(DOMAIN)])
    code = args.run_command(args)
    said = capsys.readouterr()
    return code, said.out + said.err


def test_the_nodes_reproduce_every_map_and_psi(job, capsys):
    code, out = play(job, capsys)
    assert 'maps: 3 of 3 identical' in out, out
    assert 'psi: 2 of 2 identical' in out
    assert 'setpoints: 2 of 2 identical' in out
    assert code == 0


def test_every_step_gives_what_its_question_needs(job):
    plan = steps(load(job / 'record'))
    assert [s.call.kind for s in plan] == ['begin', 'finish', 'correct', 'feed'] * 2 + [
        'begin',
        'finish',
    ]
    for step in plan:
        batches = sum(is_profile for is_profile, _ in step.inputs)
        assert batches == (58 if step.call.kind == 'finish' else 0), (
            'the late batch belongs to no map'
        )
    telemetry = sum(not p for s in plan for p, _ in s.inputs)
    topics = {}
    total = 0
    for item in records(bag_files(job / 'record')[0]):
        if isinstance(item, Channel):
            topics[item.id] = item.topic
        elif isinstance(item, Message):
            total += topics[item.channel_id] == '/telemetry'
    assert telemetry == total


def test_a_difference_is_told(make_job, tmp_path, capsys):
    """The nodes are started with what the record says; a record with another parameter does not fit its maps."""
    folder = tmp_path / 'record'
    make_job(folder)
    file = folder / 'metadata.yaml'
    changed = json.dumps({'noise': 5e-5, 'mount_xyz': [0.06, 0.0, 0.1201]})
    file.write_text(file.read_text().replace('{"noise": 5e-05}', changed))
    code, out = play(tmp_path, capsys)
    assert code == 1
    assert 'maps: 0 of 3 identical' in out, out
    assert 'map after layer 0 differs in z' in out
    assert 'psi: 2 of 2 identical' in out, 'psi is asked with the recorded surface'


def test_a_node_that_does_not_start_is_named(make_job, tmp_path, capsys):
    folder = tmp_path / 'record'
    make_job(folder)
    file = folder / 'metadata.yaml'
    file.write_text(file.read_text().replace('{"noise": 5e-05}', '{"noise": -1.0}'))
    code, said = play(tmp_path, capsys)
    assert code == 1
    assert 'scan_fusion ended' in said and 'noise' in said
