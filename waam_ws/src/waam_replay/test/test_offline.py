"""Offline replay of a recorded job: the same bits with the same parameters, other figures with others."""

import argparse
import json
import shutil

import numpy as np
import pytest

from waam_node.params import ParameterError
from waam_record.bag_writer import BagWriter, Topic
from waam_record.read_record import ReplayError, load
from waam_replay import cli, summary
from waam_replay.tune import tune

ALL = {'maps': (3, 3), 'psi': (2, 2), 'setpoints': (2, 2)}


def test_recorded_parameters_give_the_recorded_bits(job):
    """Maps come from the profiles by a fusion outside of the replay, psi and setpoints from the real nodes."""
    result = tune(job)
    assert result.identical == ALL
    assert all(m.whole for m in result.maps)
    assert result.layers[1].psi.flow_factor != 1.0, (
        'the identified process is rebuilt from the record'
    )
    assert abs(result.layers[1].psi.result.psi).max() > 0.1
    assert result.machine_seconds > 3 * 58 * 0.02


def test_two_runs_are_equal_to_the_last_bit(job):
    settings = ['correction_server.gain=0.6', 'scan_fusion.height_max=0.29']
    one, two = tune(job, settings), tune(job, settings)
    assert one.digest == two.digest != tune(job).digest
    assert json.dumps(summary.as_json(one)) == json.dumps(summary.as_json(two))


def test_profiles_that_came_after_the_map_are_left_out(job):
    """Every scan of the record has a batch that arrived too late; with it the maps would differ."""
    record = load(job)
    assert len(record.batches) == 3 * (58 + 1)
    assert tune(job).identical['maps'] == (3, 3)


def test_the_loop_mode_is_read_by_its_old_name_too(job, tmp_path):
    copy = shutil.copytree(job / 'record', tmp_path / 'record')
    file = copy / 'metadata.yaml'
    text = file.read_text()
    assert text.count('loop_mode: closed_loop') == 1
    file.write_text(text.replace('loop_mode: closed_loop', 'profile: monitor'))
    assert (load(job).loop_mode, load(copy).loop_mode) == ('closed_loop', 'monitor')


def test_less_gain_gives_less_correction(job):
    full, less = tune(job), tune(job, ['correction_server.gain=0.3'])
    assert less.identical['maps'] == (3, 3) and less.identical['psi'] == (0, 2)
    spread = [np.abs(r.layers[1].psi.result.psi).mean() for r in (full, less)]
    assert 0 < spread[1] < 0.6 * spread[0]
    assert less.layers[1].feed.difference('speed')[1] > 1e-4


def test_authority_of_speed(job):
    result = tune(job, ['correction_server.k_gain=0.1'])
    layer = result.layers[1]
    assert layer.psi.result.k_gain == 0.1
    speed = layer.feed.result.speed / layer.feed.path.speed
    assert speed.min() > 0.9 - 1e-6 and speed.max() < 1.1 + 1e-6
    wished = tune(job, ['job.k_gain=0.1'])
    assert wished.layers[1].psi.result.psi.tobytes() == layer.psi.result.psi.tobytes()


def test_a_changed_map_changes_what_follows(job):
    result = tune(job, ['scan_fusion.mount_xyz=[0.0, 0.06, 0.1203]'])
    assert result.identical['maps'] == (0, 3)


def test_the_raised_scanner_raises_the_map(job):
    result = tune(job, ['scan_fusion.mount_xyz=[0.06, 0.0, 0.1203]'])
    rms, largest = result.maps[0].difference
    assert abs(rms - 0.3e-3) < 2e-6 and abs(largest - 0.3e-3) < 1e-5
    assert result.identical['psi'] == (0, 2)
    error = result.layers[0].psi.core.error
    assert np.nanmean(error) < np.nanmean(tune(job).layers[0].psi.core.error) - 0.2e-3


@pytest.mark.parametrize(
    ('setting', 'text'),
    [
        ('correction_server.k_gian=0.2', "unknown parameter 'correction_server.k_gian'; did you mean 'k_gain'"),
        ('correction.k_gain=0.2', "unknown node 'correction' in 'correction.k_gain=0.2'; did you mean"),
        ('k_gain=0.2', "'k_gain=0.2' is not of the form node.parameter=value"),
        ('correction_server.k_gain', 'is not of the form'),
        ('correction_server.k_gain=7', 'above its limit 0.3'),
        ('correction_server.in_layer_gain=0.3', "'correction_server.in_layer_gain'; it is gone"),
        ('correction_server.law=magic', "'magic', must be one of"),
        ('correction_server.gain=often', 'must be of type float'),
    ],
)  # fmt: skip
def test_a_wrong_setting_is_named(job, setting, text):
    with pytest.raises(ParameterError) as e:
        tune(job, [setting])
    assert text in str(e.value)


def test_a_record_without_questions_is_refused(tmp_path):
    writer = BagWriter(tmp_path / 'record')
    writer.add_topic(Topic('/a', 'std_msgs/msg/String', 'string data\n'))
    writer.write(0, 1, 1, 1, b'\0\1\0\0\1\0\0\0\0')
    writer.close()
    with pytest.raises(ReplayError, match='no call of scan_fusion/finish'):
        tune(tmp_path)
    with pytest.raises(ReplayError, match='no record there'):
        tune(tmp_path / 'nowhere')


@pytest.mark.parametrize(('count', 'text'), [(1, 'the version that recorded it'), (0, 'holds no')])
def test_a_layer_that_was_corrected_while_it_was_laid_needs_the_version_that_recorded_it(
    count, text, tmp_path
):
    """Of a service that was there and never called nothing is said."""
    writer = BagWriter(tmp_path / 'record')
    kind = 'waam_msgs/srv/RenewCorrection_Event'
    writer.add_topic(Topic('/correction_server/renew/_service_event', kind, 'uint32 layer\n'))
    for k in range(count):
        writer.write(0, 1, 1, k, b'\0\1\0\0\1\0\0\0')
    writer.close()
    with pytest.raises(ReplayError, match=text):
        tune(tmp_path)


def test_parameters_of_another_version_are_named(make_job, tmp_path):
    folder = tmp_path / 'record'
    made = make_job(folder, late=False)
    assert len(made.maps) == 3
    file = folder / 'metadata.yaml'
    text = file.read_text().replace('"height_max"', '"height_maxs"')
    file.write_text(text)
    result = tune(tmp_path)
    assert any('height_maxs left out' in n for n in result.parameters.notes)
    assert any('correction_server are not in the record' in n for n in result.parameters.notes)


def test_a_cut_record_gives_what_was_before_the_cut(job, tmp_path):
    folder = tmp_path / 'record'
    folder.mkdir()
    for file in (job / 'record').iterdir():
        data = file.read_bytes()
        (folder / file.name).write_bytes(
            data[: int(len(data) * 0.3)] if file.suffix == '.mcap' else data
        )
    result = tune(tmp_path)
    assert result.record.damage
    found, total = result.identical['maps']
    assert found == total and 1 <= total < 3


def run(argv: list[str]) -> int:
    parser = argparse.ArgumentParser()
    cli.register(parser.add_subparsers())
    args = parser.parse_args(['replay', *argv])
    return args.run_command(args)


def test_commands(job, tmp_path, capsys):
    assert run(['check', str(job)]) == 0
    assert 'identical to the record: 3 of 3 maps' in capsys.readouterr().out
    out = tmp_path / 'out'
    assert run(['tune', str(job), '--set', 'correction_server.k_gain=0.2', '-o', str(out)]) == 0
    data = json.loads((out / 'tune.json').read_text())
    assert data['settings'] == {'correction_server.k_gain': 0.2}
    assert [r['layer'] for r in data['layers']] == [1, 2]
    assert data['layers'][1]['speed_difference_max_mm_s'] > 0
    assert run(['tune', str(job), '--set', 'nobody.x=1']) == 1
    assert "unknown node 'nobody'" in capsys.readouterr().err


def test_a_record_whose_answers_do_not_fit_is_told(job, tmp_path, capsys, monkeypatch):
    """The check can fail: another filter strength in the code would look like this."""
    import waam_replay.tune as module

    real = module.effective
    monkeypatch.setattr(
        module, 'effective', lambda r, s, p='': real(r, [*s, 'correction_server.gain=0.89'], p)
    )
    assert run(['check', str(job)]) == 1
    assert 'DIFFERENT' in capsys.readouterr().out


def test_many_records_one_after_the_other(job, tmp_path, capsys, monkeypatch):
    """A folder of three records (one of them cut off) and of something else."""
    jobs = tmp_path / 'jobs'
    for name in ('a', 'b', 'cut'):
        shutil.copytree(job / 'record', jobs / name / 'record')
    for file in (jobs / 'cut' / 'record').glob('*.mcap'):
        file.write_bytes(b'')
    (jobs / 'archive').mkdir()
    monkeypatch.chdir(tmp_path)
    assert run(['check', str(jobs), '-o', 'out']) == 1
    out = capsys.readouterr().out
    assert '3 records: 2 identical, 0 different, 1 errors' in out and 'cut: error' in out
    kept = json.loads((tmp_path / 'out' / 'check.json').read_text())
    assert sorted(len(f.get('maps', [])) for f in kept.values()) == [0, 3, 3]
    assert run(['check', str(jobs / 'a'), str(jobs / 'b'), '-o', 'out']) == 0
    assert run(['tune', str(jobs), '--set', 'nobody.x=1']) == 1
    assert "unknown node 'nobody'" in capsys.readouterr().err
    assert run(['check', str(jobs / 'archive')]) == 1
    assert 'no recorded job' in capsys.readouterr().err
