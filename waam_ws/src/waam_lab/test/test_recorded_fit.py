"""`waam lab fit` on recordings that are no jobs: known cells are found again, and what is not told is left alone."""

import argparse
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from waam_lab import cli_fit
from waam_lab.recorded import arc_fit
from waam_lab.recorded.arc_figures import Steady, figures, steady
from waam_lab.recorded.cooling_curves import curves
from waam_lab.recorded.cooling_fit import fit_cooling, responses
from waam_lab.recorded.finding import Finding, Parameter
from waam_lab.recorded.fit import join
from waam_lab.recorded.read import Recording, is_recording, is_wall
from waam_lab.twin.records import RecordError
from waam_sim.arc import ArcParams
from waam_sim.heat import HeatParams

DATA = Path(__file__).resolve().parents[5] / 'shared/data'
needs_data = pytest.mark.skipif(not DATA.is_dir(), reason=f'no recordings at {DATA}')
TRUE = replace(
    ArcParams(), current_ref=120.0, length_noise=0.8, sensor_noise=3.0, drift_current=6.0, drift_voltage=0.8,
    drift_correlation=-0.6, drift_time=2.5,
)  # fmt: skip


def arc_log(params, seconds=90.0, seed=5, repeats=1):
    """A log of 10 Hz of one arc; repeats: rows that say the same, as where a log is faster than its source."""
    t = np.arange(0, seconds, 0.1)
    lit = (t > 2) & (t < seconds - 2)
    n = int(lit.sum())
    wire, run = np.full(n, 0.11), np.zeros(n, int)
    seen = Steady(t[lit], wire, np.full(n, 130.0), np.full(n, 17.0), run)
    made = arc_fit.simulated(params, seen, seed)
    told = {
        'arc_current': made.current,
        'arc_voltage': made.voltage,
        'wire_feed_speed': wire,
        'arc_established': np.ones(n),
    }
    columns = {name: np.zeros(t.size) for name in told}
    for name, values in told.items():
        columns[name][lit] = values
    t = np.concatenate([t + k * 0.1 / repeats for k in range(repeats)])
    order = np.argsort(t, kind='stable')
    return Recording(
        'made', t[order], {k: np.tile(v, repeats)[order] for k, v in columns.items()}, {}
    )


def test_a_known_arc_is_found_again():
    finding, kept = arc_fit.fit_arc(arc_log(TRUE), ArcParams())
    before, after = finding.misfit
    assert after < 0.15 < 0.5 < before
    told = {p.name: p for p in finding.parameters if p.told}
    assert {'arc_current_ref', 'arc_length_noise', 'arc_sensor_noise', 'arc_drift_current'} <= set(
        told
    )
    for name in ('current_ref', 'length_noise', 'sensor_noise', 'drift_current', 'drift_voltage'):
        p = told[f'arc_{name}']
        assert p.low <= getattr(TRUE, name) <= p.high, name
        assert getattr(kept, name) == p.value
    assert any('contact distance' in text for text in finding.silent)


def test_repeated_readings_do_not_count():
    log = arc_log(TRUE, repeats=4)
    seen = steady(log.t, log.telemetry)
    assert seen.held == pytest.approx(0.75, abs=0.01)
    plain = steady((one := arc_log(TRUE)).t, one.telemetry)
    a, b = figures(seen), figures(plain)
    assert a['fast_voltage'] == pytest.approx(b['fast_voltage'], rel=0.05)


def test_short_arcs_do_not_tell_their_drift():
    whole = arc_log(TRUE, 60.0)
    lit = whole.telemetry['arc_established'] * (whole.t % 6 < 5)
    finding, kept = arc_fit.fit_arc(
        replace(whole, telemetry={**whole.telemetry, 'arc_established': lit}), ArcParams()
    )
    told = {p.name for p in finding.parameters if p.told}
    assert not any('drift' in name for name in told)
    assert kept.drift_current == ArcParams().drift_current
    assert any('too short for its drift' in note for note in finding.notes)
    assert finding.misfit[1] <= finding.misfit[0]


def test_a_log_without_an_arc_is_refused_by_name():
    log = arc_log(TRUE, 30.0)
    nothing = np.nan * log.t
    for change in ({'arc_established': 0.0 * log.t}, {'arc_current': nothing}):
        with pytest.raises(RecordError, match='made: 0.0 s of steady arc'):
            arc_fit.fit_arc(replace(log, telemetry={**log.telemetry, **change}), ArcParams())


def test_a_log_without_wire_feed_tells_scatter_and_not_the_mean():
    log = arc_log(TRUE)
    log = replace(log, telemetry={**log.telemetry, 'wire_feed_speed': np.nan * log.t})
    found, kept = arc_fit.fit_arc(log, ArcParams())
    told = {p.name for p in found.parameters if p.told}
    assert 'arc_current_ref' not in told and {'arc_length_noise', 'arc_drift_current'} <= told
    assert kept.current_ref == ArcParams().current_ref
    assert any('no wire feed' in note for note in found.notes)


def cooling(params, passes=6, period=50.0, noise=0.5, warm=400.0):
    """A place of a wall that is passed again and again, 1 Hz."""
    rng = np.random.default_rng(2)
    after, hot, plain = responses(params, warm, period)
    pieces = []
    for k in range(passes):
        t = np.arange(0.0, period - 3, 1.0)
        wall = np.interp(t, after, plain) * (warm - params.ambient)
        values = params.ambient + wall + (1 + 0.1 * k) * np.interp(t, after, hot)
        pieces.append((k * period + t, values))
    t, celsius = (np.concatenate([p[i] for p in pieces]) for i in (0, 1))
    return t, celsius + rng.normal(0, noise, t.size)


def test_known_conduction_is_found_from_cooling_curves():
    true = replace(HeatParams(), conductivity=20.0, table_conductance=150.0)
    finding, kept = fit_cooling('wall', *cooling(true), HeatParams())
    assert finding.misfit[1] < 0.3 * finding.misfit[0]
    (p,) = [p for p in finding.parameters if p.name == 'heat_conductivity']
    assert p.told and p.low <= 20.0 <= p.high and kept.conductivity == p.value
    assert '5 cooling curves' in finding.notes, 'the first one has no rise before it'


def test_curves_end_where_the_place_warms_again_or_the_instrument_ends():
    t, celsius = cooling(HeatParams())
    found, notes = curves(t, celsius)
    assert len(found) == 5 and not notes and all(46 <= c.t[-1] + 1 <= 50 for c in found)
    floor, said = curves(t, np.maximum(celsius, 500.0))
    assert all(c.celsius.min() > 500.0 for c in floor) and 'reads nothing below 500' in said[0]
    with pytest.raises(RecordError, match='flat: no cooling curve; it never gets warmer'):
        fit_cooling('flat', t, 20 + np.sin(t), HeatParams())


def parameter(low, high, told=True):
    return Parameter('arc_x', (low * high) ** 0.5, low, high, 1.0, told)


def finding(p, name):
    return Finding(name, 'arc log', (1.0, 0.5), '', (p,), (), ())


def test_recordings_that_contradict_each_other_are_named():
    (one,), notes = join([finding(parameter(1.0, 2.0), 'a'), finding(parameter(1.5, 3.0), 'b')])
    assert 1.414 < one.value < 2.2 and not notes and one.high - one.low < 1.0
    _, notes = join([finding(parameter(1.0, 2.0), 'a'), finding(parameter(5.0, 9.0), 'b')])
    assert 'arc_x' in notes[0] and 'contradict' in notes[0]
    assert join([finding(parameter(1.0, 2.0, told=False), 'a')]) == ((), ())


def run(*words):
    parser = argparse.ArgumentParser()
    cli_fit.register(parser.add_subparsers())
    args = parser.parse_args(['lab fit', *map(str, words)])
    return args.run_command(args)


def written(folder, text):
    """An imported log."""
    from waam_record import cli as record

    (folder / 'log.csv').write_text(text)
    parser = argparse.ArgumentParser()
    record.register(parser.add_subparsers())
    args = parser.parse_args(
        ['record', 'import', str(folder / 'log.csv'), '--yes', '-o', str(folder / 'log.mcap')]
    )
    assert args.run_command(args) == 0
    return folder / 'log.mcap'


def test_the_command_fits_an_imported_log(tmp_path, capsys):
    log = arc_log(TRUE, 40.0)
    columns = [log.telemetry[k] for k in ('wire_feed_speed', 'arc_current', 'arc_voltage')]
    rows = [
        f'{t:.2f},{w * 60:.3f},{i:.2f},{u:.3f}' for t, w, i, u in zip(log.t, *columns, strict=True)
    ]
    path = written(tmp_path, 'time_s,wfs_m/min,current,voltage\n' + '\n'.join(rows))
    capsys.readouterr()
    assert run(path, '--out', tmp_path / 'fit') == 0
    said = capsys.readouterr().out
    assert (
        'log.mcap: arc log' in said and 'before' in said and 'cannot tell: contact distance' in said
    )
    cell = yaml.safe_load((tmp_path / 'fit/cell.yaml').read_text())['cell']['ros__parameters']
    assert cell['arc_current_ref'] == pytest.approx(120.0, rel=0.1)
    facts = json.loads((tmp_path / 'fit/fit.json').read_text())
    assert facts['findings'][0]['misfit'][1] < facts['findings'][0]['misfit'][0]
    assert 'arc log' in (tmp_path / 'fit/report.html').read_text()
    assert is_recording(path) and not is_wall(path)
    with pytest.raises(ValueError, match='one after the other'):
        run(path, tmp_path / 'jobs', '--out', tmp_path / 'two')
    from waam_lab.cli_campaign import settings_of

    assert settings_of([], tmp_path / 'fit/cell.yaml')[0]['cell'] == cell, 'the laboratory reads it'


def test_nothing_to_fit_is_refused_with_all_reasons(tmp_path):
    path = written(tmp_path, 'time_s,temp_C\n' + '\n'.join(f'{k},{20 + k % 3}' for k in range(50)))
    with pytest.raises(ValueError, match='nothing to fit: log.mcap /temperature: no cooling curve'):
        run(path, '--out', tmp_path / 'fit')
    assert not (tmp_path / 'fit').exists()


@needs_data
def test_a_recorded_wall_tells_metal_and_scatter(tmp_path, capsys):
    assert run(DATA / 'wall_profiles', '--out', tmp_path) == 0
    facts = json.loads((tmp_path / 'fit.json').read_text())
    wall = next(f for f in facts['findings'] if f['kind'] == 'wall')
    assert wall['misfit'][1] < 0.4 * wall['misfit'][0]
    uneven = wall['figures'][-1]['recorded']
    assert 5.9 < uneven < 12.7, 'as measured by others on this wall'
