"""The U-Net is trained, exported and used; the same seed gives the same bits."""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np
import pytest
from layers_to_learn import grid_of, layer_sample, request

torch = pytest.importorskip('torch')
from waam_adapt.beads import plan_geometry  # noqa: E402
from waam_adapt.beads.features import CHANNELS  # noqa: E402
from waam_adapt.laws import net_file  # noqa: E402
from waam_adapt.laws.registry import make_law  # noqa: E402
from waam_train import cli, samples, train  # noqa: E402
from waam_train.unet import arrays  # noqa: E402

SMALL = train.Settings(steps=4, batch=2, widths=(4, 4, 4))


@pytest.fixture(scope='module')
def layers() -> list[samples.Sample]:
    torch.set_num_threads(1)
    return [layer_sample(seed) for seed in range(6, 10)]


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
    with pytest.raises(ValueError, match='do not fit'):
        train.Trainer(layers, replace(SMALL, widths=(4, 4, 8)), arrays(start.net))


def test_training_finds_the_growth_in_turns_and_gives_the_same_bits_again(tmp_path):
    layers = [layer_sample(s) for s in range(1, 9)]
    torch.set_num_threads(1)
    settings = train.Settings(steps=60, batch=2, rate=8e-3, widths=(4, 8, 8))
    trainer = train.Trainer(layers, settings)
    metrics = train.train(trainer)
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


def test_the_command_trains_exports_and_begins_with_weights(layers, tmp_path, capsys):
    samples.save(tmp_path / 'data', 8, layers[2:3])
    samples.save(tmp_path / 'data', 9, layers[3:])
    parser = argparse.ArgumentParser()
    cli.register(parser.add_subparsers())

    def run(out: str, *more: str) -> int:
        words = [
            'train',
            str(tmp_path / 'data'),
            '--steps',
            '2',
            '--out',
            str(tmp_path / out),
            *more,
        ]
        args = parser.parse_args(words)
        return args.run_command(args)

    assert run('net') == 0
    out = tmp_path / 'net' / 'unet.npz'
    loaded = net_file.load(out, CHANNELS)
    assert loaded.card['training']['steps'] == 2
    assert loaded.digest in out.with_suffix('.md').read_text()
    assert 'unet.npz: tells' in capsys.readouterr().out
    assert run('net') == 1
    assert 'exists: name another folder' in capsys.readouterr().err
    assert run('finer', '--start', str(out)) == 0
    assert net_file.load(tmp_path / 'finer' / 'unet.npz', CHANNELS).digest != loaded.digest
