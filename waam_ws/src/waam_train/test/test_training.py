"""The U-Net is trained by one process or several, on whatever device is there, and goes on where it was
stopped."""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from layers_to_learn import grid_of, layer_sample, request

torch = pytest.importorskip('torch')
from waam_adapt.beads import plan_geometry  # noqa: E402
from waam_adapt.beads.features import CHANNELS  # noqa: E402
from waam_adapt.laws import net_file  # noqa: E402
from waam_adapt.laws.registry import make_law  # noqa: E402
from waam_train import cli, loop, samples, train  # noqa: E402
from waam_train.unet import arrays  # noqa: E402

SMALL = train.Settings(steps=4, batch=2, widths=(4, 4, 4), check_every=2)
AVERAGES = """
import sys, torch
from torch import distributed
from waam_train import loop
rank, place = int(sys.argv[1]), sys.argv[2]
distributed.init_process_group('gloo', init_method=f'file://{place}', rank=rank, world_size=2)
net = torch.nn.Linear(1, 1)
net.weight.grad = torch.tensor([[1.0 + rank]])
loop.average(net)
print(loop.rank(), loop.processes(), float(net.weight.grad), net.bias.grad)
"""


@pytest.fixture(scope='module')
def layers() -> list[samples.Sample]:
    torch.set_num_threads(1)
    return [layer_sample(seed) for seed in range(6, 10)]


def test_a_training_that_was_stopped_gives_the_same_bits(layers, tmp_path):
    whole = train.Trainer(layers, SMALL)
    train.train(whole)
    first = train.Trainer(layers, SMALL)
    first.step()
    first.step()
    first.check()
    first.save(tmp_path / 'checkpoint.npz')
    second = train.Trainer(layers, SMALL)
    second.resume(tmp_path / 'checkpoint.npz')
    train.train(second)
    assert second.progress.loss == whole.progress.loss
    assert second.progress.checks == whole.progress.checks
    for name, values in arrays(whole.net).items():
        assert values.tobytes() == arrays(second.net)[name].tobytes(), name
    with pytest.raises(loop.TrainingError, match='widths = '):
        train.Trainer(layers, replace(SMALL, widths=(4, 4, 8))).resume(tmp_path / 'checkpoint.npz')
    with pytest.raises(loop.TrainingError, match='nothing to resume'):
        second.resume(tmp_path / 'none.npz')


def test_every_layer_is_seen_once_before_any_is_seen_again(layers):
    one = train.Trainer(layers * 3, replace(SMALL, batch=1))
    count = len(one.used)
    seen = [next(one._chosen(n)) for n in range(3 * count)]
    for turn in range(3):
        assert sorted(seen[turn * count : (turn + 1) * count]) == list(range(count))
    assert seen[:count] != seen[count : 2 * count]


def test_weights_to_begin_with_are_taken(layers):
    start = train.Trainer(layers, SMALL)
    start.step()
    again = train.Trainer(layers, replace(SMALL, seed=7), arrays(start.net))
    for name, values in arrays(start.net).items():
        assert values.tobytes() == arrays(again.net)[name].tobytes(), name


def test_a_device_that_is_not_there_is_refused():
    assert loop.device('cpu').type == 'cpu'
    with pytest.raises(loop.TrainingError, match='GPU'):
        loop.device('cuda:99')
    with pytest.raises(loop.TrainingError, match='abacus'):
        loop.device('abacus')


def test_gradients_are_the_mean_of_all_processes(tmp_path):
    started = [
        subprocess.Popen(
            [sys.executable, '-c', AVERAGES, str(rank), str(tmp_path / 'meet')],
            stdout=subprocess.PIPE,
            text=True,
        )
        for rank in (0, 1)
    ]
    told = [p.communicate(timeout=120)[0].split() for p in started]
    assert told == [['0', '2', '1.5', 'None'], ['1', '2', '1.5', 'None']]


def test_training_finds_the_growth_in_turns_and_gives_the_same_bits_again(tmp_path):
    layers = [layer_sample(s) for s in range(1, 9)]
    torch.set_num_threads(1)
    settings = train.Settings(steps=60, batch=2, rate=8e-3, widths=(4, 8, 8))
    trainer = train.Trainer(layers, settings)
    metrics = train.train(trainer, tmp_path)
    assert metrics['explained'] > 0.4
    short = replace(settings, steps=4)
    again = [train.Trainer(layers, short) for _ in range(2)]
    for one in again:
        train.train(one)
    weights = [arrays(one.net) for one in again]
    for name, values in weights[0].items():
        assert values.tobytes() == weights[1][name].tobytes()
    train.export(trainer, layers, metrics, tmp_path / 'g.npz')
    law = make_law('unet', model=str(tmp_path / 'g.npz'))
    r = request()
    found = law.forecast(r)
    assert found.doubt == ''
    turn = plan_geometry.build(r, grid_of(r))[plan_geometry.NAMES.index('turn')]
    inside = grid_of(r).mean(r.footprint.astype(float)) > 0.99
    assert np.corrcoef(found.shape[inside], turn[inside])[0, 1] > 0.5
    assert 'seeds 1 to 8' in (tmp_path / 'g.md').read_text()


def arguments(folder: Path, *more: str) -> list[str]:
    return [
        'train', str(folder / 'data'), '--out', str(folder / 'net'), '--batch', '2', '--check-every', '2',
        '--widths', '4', '4', '4', '--device', 'cpu', *more,
    ]  # fmt: skip


def test_the_command_trains_exports_and_goes_on(layers, tmp_path, capsys):
    samples.save(tmp_path / 'data', 8, layers[2:3])
    samples.save(tmp_path / 'data', 9, layers[3:])
    parser = argparse.ArgumentParser()
    cli.register(parser.add_subparsers())

    def run(*more: str) -> int:
        args = parser.parse_args(arguments(tmp_path, *more))
        return args.run_command(args)

    assert run('--steps', '2') == 0
    out = tmp_path / 'net' / 'unet.npz'
    loaded = net_file.load(out, CHANNELS)
    assert loaded.card['training']['steps'] == 2
    assert loaded.digest in out.with_suffix('.md').read_text()
    assert (tmp_path / 'net' / 'curves.png').read_bytes()[:4] == b'\x89PNG'
    assert 'unet.npz: tells' in capsys.readouterr().out
    assert run('--steps', '4') == 1
    assert '--resume' in capsys.readouterr().err
    assert run('--steps', '4', '--resume') == 0
    assert net_file.load(out, CHANNELS).digest != loaded.digest
    assert run('--steps', '2', '--start', str(out), '--out', str(tmp_path / 'finer')) == 0
    assert (tmp_path / 'finer' / 'unet.npz').exists()


def test_two_processes_train_one_network(layers, tmp_path):
    samples.save(tmp_path / 'data', 8, layers[2:3])
    samples.save(tmp_path / 'data', 9, layers[3:])
    done = subprocess.run(
        [sys.executable, '-m', 'torch.distributed.run', '--standalone', '--nproc-per-node', '2',
         '-m', 'waam_bringup.cli', *arguments(tmp_path, '--steps', '2')],
        env={**os.environ, 'OMP_NUM_THREADS': '1'}, capture_output=True, text=True, timeout=240, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout.count('2 process(es) on cpu') == 1
    assert net_file.load(tmp_path / 'net' / 'unet.npz', CHANNELS).card['training']['processes'] == 2
    alone = train.Trainer(layers[2:], replace(SMALL, steps=2))
    train.train(alone)
    weights = np.load(tmp_path / 'net' / 'unet.npz')
    assert not np.array_equal(weights['head.weight'], arrays(alone.net)['head.weight'])
