"""`waam lab fit`: parameters found within their intervals, what is not told named, wrong folders refused."""

from __future__ import annotations

import json
import re
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from rich.console import Console

from waam_bringup.cli import main
from waam_lab import cli_fit, params
from waam_lab.cli_fit import each_on
from waam_lab.twin import records, solve, strike, timeline
from waam_lab.twin.along import Line
from waam_lab.twin.compare import Comparison, seen
from waam_lab.twin.electric import Steady, current, scatter
from waam_lab.twin.replay import Replay
from waam_lab.twin.unknowns import ALL, NEVER, REPLAYED, physics
from waam_node.spread import Workers
from waam_process.operating import PRESETS
from waam_sim.config import CellParams, plant_params
from waam_sim.plant import PlantParams

sys.path.insert(0, str(Path(__file__).parent))
import twin_record  # noqa: E402

USUAL = PlantParams()
TRUTH = replace(
    USUAL,
    metal=replace(
        USUAL.metal, transfer=0.82, width_ref=7.5e-3, levelling=0.7, area_noise_layer=0.03
    ),
    heat=replace(USUAL.heat, table_conductance=700.0),
    arc=replace(USUAL.arc, current_ref=150.0),
)


@pytest.fixture(scope='module')
def job(tmp_path_factory):
    folder = tmp_path_factory.mktemp('jobs') / 'one'
    return twin_record.write(folder, twin_record.record(TRUTH))


def fit(*arguments) -> int:
    return main(['lab', 'fit', *map(str, arguments)])


def refused(capsys, *arguments) -> str:
    with pytest.raises(SystemExit) as ended:
        sys.exit(fit(*arguments))
    assert ended.value.code == 2
    return capsys.readouterr().err


def test_a_cell_is_found_from_its_records(job, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(solve, 'ROUNDS', 2)  # enough for one small job, and quick
    monkeypatch.setattr(solve, 'SCATTERS', 8)
    assert fit(job, '--out', tmp_path / 'cell') == 0
    facts = json.loads((tmp_path / 'cell/fit.json').read_text())
    found = facts['parameters']
    told = {k for k, v in found.items() if v['told']}
    moved = {
        'metal_transfer': 0.82, 'metal_levelling': 0.7,
        'heat_table_conductance': 700.0, 'arc_current_ref': 150.0,
    }  # fmt: skip
    assert set(moved) <= told
    for name, true in moved.items():
        assert found[name]['low'] <= true <= found[name]['high'], (name, found[name])
    assert found['metal_transfer']['high'] - found['metal_transfer']['low'] < 0.1
    assert 'metal_spatter_per_m' not in told, 'all contact distances are nearly the same'
    (before, after) = facts['jobs'][0]['height']
    assert after < 0.6 * before

    loaded = params.read_file(tmp_path / 'cell/cell.yaml')
    cell = plant_params(params.make(loaded).cell)
    scatter = set(params.of_preset('gentle'))
    assert set(loaded['cell']) - {'heat_ambient', 'heat_initial'} == told | scatter
    others = [plant_params(params.make(loaded, preset=name).cell) for name in PRESETS]
    assert others == [cell] * 3, 'the fitted cell, whatever the preset'
    assert cell.metal.transfer == pytest.approx(found['metal_transfer']['value'], rel=1e-3)
    assert cell.metal.spatter_per_m == USUAL.metal.spatter_per_m
    page = (tmp_path / 'cell/report.html').read_text()
    assert page.count('<img') >= 3 and 'arc_wire_ratio' in page
    said = capsys.readouterr().out
    assert 'not told' in said and 'metal_spatter_per_m' in said
    assert facts['strikes']['safe'] and 'may end without an arc' not in said + page
    assert 'thinnest start of an arc' in said and not list((tmp_path / 'cell').glob('pieces*'))


def test_workers_give_the_same_bits(job):
    """Two jobs on one and on two processes."""
    base = replace(USUAL, heat=replace(USUAL.heat, ambient=20.0))
    cases = [solve.Case.of(Replay(records.read(job)), 20.0) for _ in range(2)]
    task = solve.Task(cases[0], base, np.zeros(len(REPLAYED)), 0.045, 3, 2)
    slopes = solve.slopes_of(task)
    tasks = [replace(task, case=c, slopes=slopes, seed=k) for k, c in enumerate(cases)]
    preload = ('waam_lab.twin.solve',)
    one, two = (list(each_on(Workers(n, preload=preload))(solve.scatter_of, tasks)) for n in (1, 2))
    assert [o.loud for o in one] == [t.loud for t in two] and one[0].loud != one[1].loud
    np.testing.assert_array_equal([o.covariance for o in one], [t.covariance for t in two])


class Ends:
    """Stands for a task of a fit: counts how often it is done, and Ctrl-C comes at the one of this number."""

    def __init__(self, at: int) -> None:
        self.at, self.done, self.__name__ = at, 0, 'laid_of'

    def __call__(self, task):
        self.done += 1
        if self.done == self.at:
            raise KeyboardInterrupt
        return solve.laid_of(task)


def test_a_fit_that_was_ended_goes_on_with_the_same_command(job, tmp_path, capsys, monkeypatch):
    """Ctrl-C at the third step; then only what was missing is laid, and the results are those of one go."""
    monkeypatch.setenv('WAAM_JOBS', str(tmp_path / 'jobs'))
    monkeypatch.setattr(
        cli_fit, 'spread', lambda todo, work, *_: ((k, work(t)) for k, t in todo.items())
    )
    at = [np.full(len(REPLAYED), u) for u in (0.0, 0.1, 0.2, 0.3)]

    def short(records, base, tick, each):
        tasks = [solve.Task(solve.Case.of(Replay(r), 20.0), base, u) for r in records for u in at]
        found = []
        for one in each(work, tasks):
            found.append(one)
            tick(len(tasks))
        results.append(found)
        raise ValueError('enough')

    monkeypatch.setattr('waam_lab.twin.fit.fit', short)
    results, work = [], Ends(3)
    assert fit(job) == 130
    said = capsys.readouterr().err
    assert '2 of 4 steps done' in said and 'the same command goes on' in said
    work = Ends(0)
    assert fit(job) == 2 and work.done == 2
    work = Ends(0)
    assert fit(job, '--out', tmp_path / 'other') == 2 and work.done == 4
    for one, two in zip(*results, strict=True):
        np.testing.assert_array_equal(one.growth[1], two.growth[1])
    other = records.read(job)
    assert replace(other, nominal=other.nominal + 1e-6).fingerprint != other.fingerprint


def test_what_the_laboratory_notes_of_its_cell_is_not_read(job):
    """job.yaml of a simulated job holds the parameters of its cell; a fit that looked there would be a pretence."""
    without = records.read(job)
    (job / 'job.yaml').write_text('nodes: {cell: {metal_transfer: 0.5}}')
    with_it = records.read(job)
    np.testing.assert_array_equal(without.first, with_it.first)
    assert without.spots == with_it.spots
    source = [f.read_text() for f in records.Path(records.__file__).parent.glob('*.py')]
    assert not any('job_folder.JOB' in text for text in source)


def test_the_cell_itself_lays_what_it_laid(job):
    """With its own parameters, the job laid anew differs by scatter alone; with too little metal it shows."""
    replay = Replay(records.read(job))
    comparison = Comparison(replay)
    own = comparison.volume(replay.run(TRUTH))
    assert own == pytest.approx(1.0, abs=0.03)
    less = replay.run(physics(TRUTH, {'metal_transfer': 0.82 * 0.9}))
    assert comparison.volume(less) == pytest.approx(0.9 * own, abs=0.01)


def test_arcs_begin_and_end_where_the_telemetry_says_so():
    t = np.arange(10) / 10
    lit = np.array([0, 0, 0, 1, 1, 1, 0, 0, 1, 1.0])
    changed = np.full(10, np.nan)
    changed[[3, 6, 8]] = 0.21, 0.58, 0.75
    np.testing.assert_allclose(
        timeline.arcs({'t': t, 'arc': lit, 'arc_changed': changed}), [[0.21, 0.58], [0.75, 0.9]]
    )
    old = timeline.arcs({'t': t, 'arc': lit})  # of records before that column
    np.testing.assert_allclose(old, [[0.25, 0.55], [0.75, 0.9]])


def test_the_torch_turns_corners_between_two_rows_of_telemetry():
    corners = np.array([[0, 0], [20, 0], [20, 4], [0, 4]]) * 1e-3  # there, across, back
    line = Line(corners[:-1], corners[1:])
    t = np.arange(0.0, 4.4, 0.005)
    way = np.interp(0.01 * t, [0, 0.020, 0.024, 0.044], [0, 1, 2, 3])
    true = np.column_stack([np.interp(way, range(4), corners[:, k]) for k in (0, 1)])
    rows = np.arange(10, t.size, 20)  # 10 Hz; corners lie in the middle between two
    off = np.hypot(*(line.follow(t[10:-20], t[rows], true[rows]) - true[10:-20]).T)
    chords = [np.interp(t[10:-20], t[rows], true[rows, k]) for k in (0, 1)]
    assert np.hypot(*(np.array(chords).T - true[10:-20]).T).max() > 3e-4
    assert off.max() < 1e-5


@pytest.mark.parametrize('beside', [4e-4, 5e-3])
def test_what_the_torch_lies_beside_the_planned_line_is_kept(beside):
    line = Line(np.zeros((1, 2)), np.array([[0.02, 0.0]]))
    t = np.linspace(0.0, 1.0, 11)
    rows = np.column_stack([0.01 * t, np.full(11, beside)])
    np.testing.assert_allclose(line.follow(np.array([0.25]), t, rows), [[0.0025, beside]])


def test_a_map_shows_means_over_its_cells():
    x = np.arange(12) * 0.5
    ridges = np.tile(np.cos(1.5 * x), (12, 1))
    fine = np.cos(1.5 * (x[5] + np.linspace(-0.25, 0.25, 501))).mean()
    assert seen(ridges)[6, 5] == pytest.approx(fine, abs=5e-3 * abs(ridges[6, 5]))
    np.testing.assert_allclose(seen(np.full((5, 5), 0.7)), 0.7)


STEEP = replace(USUAL.arc, current_ref=134.0, current_exponent=0.77, length_noise=0.28)
THIN, CONTACT = 0.0375, 15e-3  # m/s, m


def rows(arc, wire: float, n: int = 1500) -> Steady:
    """Of one arc: noise of its length moves voltage and current, other noise the current alone."""
    rng = np.random.default_rng(4)
    length, other = arc.length_noise * rng.standard_normal(n), 4.0 * rng.standard_normal(n)
    feed, contact = np.full(n, wire), np.full(n, CONTACT)
    amps = current(arc, feed * arc.wire_ratio, contact) - 0.665 * arc.current_noise * length
    amps += other
    volts = 22.0 + length - arc.resistance * amps
    return Steady(feed, contact, amps, volts, np.zeros(n, int))


def test_noise_of_the_current_is_what_goes_with_the_voltage():
    for true in (4.0, 10.0):
        arc = replace(USUAL.arc, current_noise=true)
        value, error = scatter(rows(arc, 0.08), arc)['current_noise']
        assert value == pytest.approx(true * (1 + 1.41 * (0.15 / 0.45) ** 2), rel=0.15)
        assert 0 < error < 0.15


def test_an_arc_that_is_too_weak_to_strike_is_told():
    """A steep cell at thin beads strikes near 30 A: now it burns, now it does not; less scatter, fewer strikes."""
    usual, steep = (strike.strikes(a, rows(a, THIN)) for a in (USUAL.arc, STEEP))
    assert usual.safe and usual.current > 35 and not steep.safe and 28 < steep.current < 31
    assert usual.sure < THIN < steep.sure < 0.05
    assert strike.chance(STEEP, 1.1 * steep.sure, CONTACT) > strike.SURE > steep.chance > 0.3
    assert strike.chance(replace(STEEP, current_noise=2.0), THIN, CONTACT) < steep.chance - 0.1
    out = Console(record=True, width=300)
    cli_fit.show(SimpleNamespace(estimates=(), misfits=(), strikes=steep), out)
    said = out.export_text()
    assert 'may end without an arc' in said and '2.25 m/min' in said


def test_strikes_are_judged_as_by_the_controller():
    source = Path(__file__).parents[2] / 'waam_firmware/core/machine/waam_config.c'
    text = source.read_text()
    told = [
        float(re.search(rf'\.{name} = ([\d.]+)', text)[1])
        for name in ('strike_wire_factor', 'established_a', 'established_us', 'strike_us', 'tries')
    ]
    own = (
        strike.WIRE_FACTOR,
        strike.ESTABLISHED,
        strike.HOLDS * 1e3,
        strike.WAITS * 1e3,
        strike.TRIES,
    )
    assert told == list(own)


def test_what_is_looked_for_exists_and_is_believed_possible():
    fields = CellParams.__dataclass_fields__
    for k in ALL:
        assert k.name in fields and k.words and k.doubt < 2 * k.spread or k.log
        low, high = (float(k.value(u)) for u in (-3, 3))
        meta = fields[k.name].metadata
        assert meta['minimum'] <= low < k.usual < high <= meta['maximum'], k.name
        assert k.standard(float(k.value(0.7))) == pytest.approx(0.7)
    for names in NEVER:
        for name in names.split(', '):
            assert name in fields, name
            assert name not in {k.name for k in ALL}, name


def test_wrong_folders_are_refused_by_name(job, tmp_path, capsys):
    assert 'no such folder' in refused(capsys, tmp_path / 'nothing')
    (tmp_path / 'empty').mkdir()
    assert 'is not a job folder' in refused(capsys, tmp_path / 'empty')
    (tmp_path / 'blind/layers').mkdir(parents=True)
    assert 'no height maps' in refused(capsys, tmp_path / 'blind')
    assert 'JOBS' in refused(capsys)
    spoiled = twin_record.write(tmp_path / 'torn', records.read(job))
    (spoiled / 'telemetry.npz').write_bytes(b'PK torn')
    text = refused(capsys, spoiled)
    assert 'telemetry.npz' in text and 'damaged' in text
    (spoiled / 'telemetry.npz').unlink()
    assert 'did not come to its end' in refused(capsys, spoiled)
    cold = {**records.read(job).telemetry}
    cold['arc'] = cold['arc'] * 0
    np.savez(spoiled / 'telemetry.npz', **cold)
    assert 'never burned' in refused(capsys, spoiled)


def test_help_teaches(capsys):
    with pytest.raises(SystemExit) as ended:
        main(['lab', 'fit', '--help'])
    assert ended.value.code == 0
    said = capsys.readouterr().out
    for word in ('cell.yaml', 'not told', '--cell-file', 'exit status'):
        assert word in said
