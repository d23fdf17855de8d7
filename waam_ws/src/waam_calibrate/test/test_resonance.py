"""From samples to a mode: the sweep on the real controller core against the simulated axes, and poor evidence."""

from __future__ import annotations

import argparse
import dataclasses
from functools import cache

import numpy as np
import pytest
from shaken import Shaker

from waam_calibrate import cli, report, results, store
from waam_calibrate.evidence import EvidenceError
from waam_calibrate.graph import Graph
from waam_calibrate.outcome import of_resonance
from waam_calibrate.pictures import measured, spectra
from waam_calibrate.resonance import Mode, Resonance, Samples, analyse, energy, fit
from waam_calibrate.shapers import Candidate
from waam_calibrate.sweep import Sweep
from waam_sim.gantry import GantryParams

SWEEP = Sweep(low=5.0, rate=4.0)


@cache
def shaken() -> tuple[Samples, float]:
    """Samples of a sweep of x, and the true frequency."""
    with Shaker(GantryParams(on=True)) as shaker:
        return shaker.sweep(SWEEP, 'x'), shaker.plant.gantry.hz(0, 0.2)


def test_mode_and_shaper_of_the_simulated_axis() -> None:
    samples, true = shaken()
    found = analyse(samples, SWEEP, 'x')
    assert found.mode.hz == pytest.approx(true, rel=0.01)
    assert found.mode.damping == pytest.approx(0.05, abs=0.01)
    assert found.chosen.vibration < 0.05
    names = [name for name, _ in found.settings()]
    assert names == ['shape_x', 'shape_x_hz', 'shape_x_damping', 'shape_x']
    assert all(p.startswith(b'\x89PNG') for p in (spectra(found), measured(found)))
    result = of_resonance(found, SWEEP)
    assert result.values['mode_hz'] == found.mode.hz and not result.refuses


@pytest.mark.parametrize(
    ('proposed', 'limit', 'told', 'words'),
    [
        (1300.0, 500.0, 500.0, 'acceleration 500 mm/s^2 (1300 proposed, the machine has at most 500)'),
        (300.0, 500.0, 300.0, 'acceleration 300 mm/s^2 (300 proposed, the machine has at most 500)'),
        (300.0, 237.0, 237.0, 'acceleration 237 mm/s^2 (300 proposed, the machine has at most 237)'),
        (0.0, 500.0, None, 'acceleration left as it is (none keeps the smoothing below 0.12 mm)'),
    ],
)  # fmt: skip
def test_the_acceleration_is_the_proposed_one_but_never_above_the_machine(
    proposed, limit, told, words
) -> None:
    """It is in the settings before the shaper, in the line of the result and in its page."""
    taken = Candidate('zvd', 40.0, 0.01, 0.05, proposed)
    found = Resonance('y', *(np.ones(9),) * 3, np.ones((9, 3)), Mode(40.0, 0.05, 1.0), [taken])
    sweep = Sweep(low=5.0, rate=4.0, acceleration=1e-3 * limit)
    result = of_resonance(found, sweep)
    shaper = ['shape_y', 'shape_y_hz', 'shape_y_damping', 'shape_y']
    assert [n for n, _ in result.settings] == ['max_accel_y'] * (told is not None) + shaper
    assert dict(result.settings).get('max_accel_y') == told
    assert result.text.endswith(words) and words in report.page(result)
    assert result.values['acceleration_mm_s2'] == proposed
    assert result.values['acceleration_limit_mm_s2'] == pytest.approx(limit)


def test_the_commanded_motion_is_that_of_the_controller() -> None:
    """Within two steps at the begin, one tick in a thousand at the end."""
    with Shaker(GantryParams(on=True)) as shaker:
        shaker.go(((0.2, 0.15, 0.1), 0.1))
        table: list[np.ndarray] = []
        shaker.machine.on_exchange = lambda samples, plant: table.append(-samples['table_x'])
        sweep = Sweep(low=20.0, high=80.0, rate=10.0)
        shaker.run(sweep.segments('x', (0.2, 0.15, 0.1), 1))
        real = np.round((np.concatenate(table) - 0.2) * 320e3)
    told = np.round(np.cumsum(np.cumsum(sweep.commanded())) * 1e-6 * 320e3)
    real, told = real[np.argmax(real != 0) :], told[np.argmax(told != 0) :]
    assert abs(real[:500] - told[:500]).max() <= 2
    assert np.flatnonzero(real)[-1] == pytest.approx(np.flatnonzero(told)[-1], rel=1e-3)


@pytest.mark.parametrize('zero', [0.0, 0.0123457])
def test_moves_of_less_than_a_step_are_executed_up_to_134_hz(zero) -> None:
    """From the step next to any point, of any work frame, and as the analysis takes them for."""
    sweep = Sweep(low=90.0, high=134.0, rate=10.0)
    x = sweep.on_step((0.2 - zero, 0.15, 0.1), 'x', (zero, 0.0, 0.0))[0] + zero
    assert abs(x - 0.2) <= 0.5 * sweep.step
    with Shaker(GantryParams(on=True)) as shaker:
        shaker.go(((x, 0.15, 0.1), 0.1))
        table: list[np.ndarray] = []
        shaker.machine.on_exchange = lambda samples, plant: table.append(-samples['table_x'])
        shaker.run(sweep.segments('x', (x, 0.15, 0.1), 1))
    steps = np.concatenate(table) / sweep.step
    real = np.trim_zeros(np.round(steps - steps[0]))
    told = np.trim_zeros(np.round(np.cumsum(np.cumsum(sweep.commanded())) * 1e-6 / sweep.step))
    assert sweep.top == 134.0 and abs(len(real) - len(told)) <= 5
    assert np.count_nonzero(np.diff(real)) >= len(sweep.moves) - 2, 'a step for every move'
    power = [energy(np.diff(way, n=2), 1e3, 0.0) for way in (real, told)]
    bands = [p[2 * 94 : 2 * 134].reshape(-1, 16).sum(axis=1) for p in power]  # of 8 Hz
    assert bands[0] == pytest.approx(bands[1], rel=0.2)


def test_a_mode_above_the_frequency_of_whole_steps_is_found() -> None:
    sweep = Sweep(low=60.0, rate=4.0)
    with Shaker(GantryParams(on=True, x_hz=118.0, x_second_hz=270.0)) as shaker:
        samples, true = shaker.sweep(sweep, 'x'), shaker.plant.gantry.hz(0, 0.2)
    assert analyse(samples, sweep, 'x').mode.hz == pytest.approx(true, rel=0.01)


def test_samples_are_kept_with_their_sweep(tmp_path) -> None:
    """Judged by the sweep that they were taken in, whatever the options say."""
    samples, sweep = changed(values=np.ones((40, 3)), rest=np.zeros((9, 3))), Sweep(5.0, 60.0, 4.0)
    store.save_samples(tmp_path / 'a.npz', samples, sweep)
    again, kept = store.load_samples(tmp_path / 'a.npz')
    assert kept == sweep and again.rate == samples.rate and (again.values == 1).all()


@pytest.mark.parametrize('told', [None, {}, {'steps_per_mm_x': 400.0, 'accel_limit_x': 250.0}])
def test_the_sweep_has_steps_and_acceleration_of_the_controller(tmp_path, told) -> None:
    seen: list[Sweep] = []

    def measure(args, sweep, axis, point):
        seen.append(sweep)
        raise EvidenceError('enough')

    graph = Graph(
        lambda: tmp_path,
        lambda p: None,
        measure,
        lambda *_: '',
        lambda args: told,
        lambda path: None,
    )
    parser = argparse.ArgumentParser()
    cli.register(parser.add_subparsers(), graph)
    args = parser.parse_args(['calibrate', 'resonance', '--axis', 'x'])
    with pytest.raises(EvidenceError, match='enough'):
        args.run_command(args)
    assert seen[0].step == pytest.approx(1e-3 / (400.0 if told else 320.0))
    assert seen[0].acceleration == pytest.approx(0.25 if told else 0.5)


def test_the_acceleration_is_told_and_its_loss_is_noticed(tmp_path, capsys) -> None:
    """From kept samples: status names what the controller lacks, apply tells it; a dry run does neither."""
    samples, _ = shaken()
    told = {'max_accel_x': 500.0, 'shape_x': 0.0}
    graph = Graph(
        lambda: tmp_path / 'kept',
        lambda p: None,
        lambda *_: samples,
        lambda args, settings: told.update(settings) or '',
        lambda args: told,
        lambda path: None,
    )
    slow = dataclasses.replace(SWEEP, acceleration=0.45)
    store.save_samples(tmp_path / 's.npz', samples, slow)
    parser = argparse.ArgumentParser()
    cli.register(parser.add_subparsers(), graph)

    def verb(line: str) -> str:
        args = parser.parse_args(['calibrate', *line.split()])
        assert args.run_command(args) == 0
        return capsys.readouterr().out

    again = f'resonance --axis x --samples {tmp_path / "s.npz"}'
    assert 'acceleration 450 mm/s^2' in verb(f'{again} --dry-run')
    assert not (tmp_path / 'kept').exists() and told['max_accel_x'] == 500.0
    assert 'acceleration 450 mm/s^2' in verb(again)
    (kept,) = store.load_all(tmp_path / 'kept').results
    assert dict(kept.settings)['max_accel_x'] == 450.0
    said = verb('status')
    assert 'acceleration 450 mm/s^2' in said
    assert 'max_accel_x is 500 in the controller, 450 was found (waam calibrate apply)' in said
    verb('apply')
    assert told['max_accel_x'] == 450.0 and not results.missing([kept], told)
    assert 'waam calibrate apply' not in verb('status')


@pytest.mark.parametrize(('before', 'behind'), [(0.3, 0.0), (0.7, 1.6)])
def test_rest_around_the_sweep_changes_nothing(before, behind) -> None:
    """In the graph the record begins and ends somewhere at rest. The end of the sweep must not look like a mode."""
    samples, true = shaken()
    rest = np.concatenate([samples.rest, samples.rest])
    values = np.concatenate(
        [rest[: round(before * samples.rate)], samples.values, rest[: round(behind * samples.rate)]]
    )
    found = analyse(changed(values=values), SWEEP, 'x')
    assert found.mode.hz == pytest.approx(true, rel=0.01)
    assert found.gain[found.hz > 90].max() < 0.1 * found.gain.max()


def second_order(hz: np.ndarray, mode: float, damping: float) -> np.ndarray:
    r = hz / mode
    return (1 + (2 * damping * r) ** 2) / ((1 - r**2) ** 2 + (2 * damping * r) ** 2)


@pytest.mark.parametrize(('hz', 'damping'), [(22.0, 0.1), (41.3, 0.05), (88.0, 0.03)])
def test_fit_of_a_synthetic_plant(hz, damping) -> None:
    at = np.arange(5.0, 134.0, 0.5)
    assert fit(at, second_order(at, hz, damping)).hz == pytest.approx(hz, rel=0.001)
    noise = np.random.default_rng(3).chisquare(400, len(at)) / 400  # 7 % of the power
    found = fit(at, second_order(at, hz, damping) * noise)
    assert found.hz == pytest.approx(hz, rel=0.015)
    assert found.damping == pytest.approx(damping, rel=0.15)


def changed(**fields: object) -> Samples:
    return dataclasses.replace(shaken()[0], **fields)


def test_poor_evidence_is_refused_with_the_reason() -> None:
    samples, _ = shaken()
    rng = np.random.default_rng(1)
    for text, bad in (
        ('too few samples', changed(values=samples.values[:1000])),
        ('too few samples at rest', changed(rest=samples.rest[:100])),
        ('clipped', changed(values=np.clip(samples.values, -1.0, 1.0), range=1.0)),
        ('no motion', changed(values=rng.normal(0, 0.04, samples.values.shape))),
        ('lost on the way', changed(lost=10**6)),
        ('not a finite', changed(values=np.full_like(samples.values, np.nan))),
        ('are too few for', changed(rate=100.0)),
    ):
        with pytest.raises(EvidenceError, match=text):
            analyse(bad, SWEEP, 'x')


def test_a_rigid_axis_needs_no_shaper() -> None:
    """Flat: what was measured is what was commanded."""
    samples, _ = shaken()
    at = np.arange(len(samples.values)) / samples.rate
    commanded = SWEEP.commanded()
    # as an accelerometer with 3200 samples/s sees it: each push is one sample
    values = np.random.default_rng(2).normal(0, 0.01, samples.values.shape)
    ticks = np.minimum((at * 1000).astype(int), len(commanded) - 1)
    values[:, 0] += np.where(np.diff(ticks, prepend=-1) > 0, commanded[ticks] * 3.2, 0.0)
    rigid = changed(values=values, rest=np.random.default_rng(4).normal(0, 0.01, (9000, 3)))
    with pytest.raises(EvidenceError, match='flat|edge of the band'):
        analyse(rigid, SWEEP, 'x')


def test_a_sweep_out_of_range_is_refused() -> None:
    for bad in ({'low': 0.1}, {'high': 1.0}, {'rate': 0.0}, {'acceleration': 0.0}):
        with pytest.raises(ValueError, match='sweep|must be'):
            Sweep(**bad)
