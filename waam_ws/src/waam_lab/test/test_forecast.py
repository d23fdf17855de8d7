"""Forecasts: bands that hold what they promise, verdicts, causes, and the files that a job finds."""

from __future__ import annotations

import json
import math
import shlex
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from waam_bringup.cli import build_parser, main
from waam_job.model.goal import check
from waam_job.store import forecasts
from waam_lab import restore
from waam_lab.causes import ENDS, FREE, LEVEL, NOT_LAID, PLACES, STANDING, places, shares
from waam_lab.forecast import LOG, SHARE, Forecast, chance, expected, facts, verdict, words
from waam_lab.job import LabMaps, LabResult
from waam_lab.layouts import OTHERS, Trial
from waam_lab.plants import FIRST_CELL, on_cells
from waam_plan.cli import _forecast
from waam_plan.layers.restore import plan_restoration
from waam_plan.settings import PlanSettings
from waam_process.grid import GridSpec, HeightGrid
from waam_sim.plant import PlantParams


def result(seed, rms=0.2e-3, good=False, **fields) -> LabResult:
    word = 'in tolerance' if good else 'out of tolerance'
    figures = {'share_in_tolerance': 0.8, 'time': 700.0, 'wire': 5.0, 'volume': 5e-6, **fields}
    return LabResult(seed, figures.pop('verdict', word), 0, '', rms=rms, **figures)


@pytest.mark.parametrize(
    'count,sigma,low,high',
    [
        (12, 0.15, 0.87, 0.97),
        (12, 0.25, 0.87, 0.95),
        (12, 0.35, 0.85, 0.93),
        (1, 0.25, 0.90, 0.98),  # the prior spread alone, which is the true one here
        (3, 0.35, 0.80, 0.95),
    ],
)
def test_bands_hold_nine_of_ten_jobs(count, sigma, low, high):
    rng = np.random.default_rng(count)
    hits = []
    for _ in range(2000):
        values = 0.2e-3 * np.exp(sigma * rng.normal(size=count + 1))
        e = expected(values[:-1], LOG)
        hits.append(e.low <= values[-1] <= e.high)
    assert low <= np.mean(hits) <= high


def test_more_cells_narrow_a_band_and_shares_stay_shares():
    few, many = (expected([0.9, 0.95] * n, SHARE) for n in (1, 6))
    assert many.high - many.low < few.high - few.low
    sure = expected([1.0] * 4, SHARE)
    assert sure.high == 1.0 and 0 < sure.low < 1
    assert expected([0.0] * 4, SHARE).low == 0.0


def test_a_chance_from_few_cells_is_not_certain():
    assert chance(4, 4).value == pytest.approx(0.9) and chance(4, 4).low < 0.8
    assert chance(0, 4).value == pytest.approx(0.1)
    assert chance(12, 12).low > chance(4, 4).low


def test_the_verdict_tells_a_failure_its_cause_and_what_would_do(parts):
    job = restore(*parts)
    machined = Trial(
        OTHERS[0],
        (result(1, verdict='cleans up', clean_share=1.0, stock_mean=0.6e-3, good=True),),
    )
    held = {'class': 'height', 'reaction': 'arc ended, machine held, job paused', 'text': 'sinks'}
    bad = Forecast(job, (result(1, anomalies=(held,)), result(2)), (machined,), machined, 20.0)
    assert bad.fails and verdict(bad) == 'will not be in tolerance: 0 of 2 cells'
    told = ' | '.join(words(bad))
    assert 'stopped on a cell: sinks' in told
    assert 'finish machined (--finish machined): cleans up on 1 of 1 cells, stock 0.60 mm' in told
    good = Forecast(job, tuple(result(k, good=True) for k in range(4)))
    assert not good.fails and verdict(good) == 'will be in tolerance: 4 of 4 cells'
    assert words(good) == []
    unsure = Forecast(job, tuple(result(k, good=True) for k in range(2)))
    assert not unsure.fails and verdict(unsure).startswith('may be in tolerance: 2 of 2 cells')


def test_a_job_that_cannot_be_laid_is_told_by_its_reason(parts):
    refused = LabResult(1, 'failed', 106, 'overhang of 70 deg')
    machined = restore(*parts, plan_settings=('finish=machined',))
    assert facts(Forecast(machined, (refused,)))['finish'] == 'machined'
    f = Forecast(restore(*parts), (refused, refused))
    assert f.fails and verdict(f) == 'it fails: overhang of 70 deg' and not f.rows
    assert facts(f)['figures'] == {}


def test_the_file_has_every_figure_in_the_unit_of_its_name(parts):
    f = Forecast(restore(*parts), tuple(result(k, rms) for k, rms in enumerate((0.2e-3, 0.3e-3))))
    found = facts(f, 'waam forecast')
    assert found['figures']['rms_mm']['value'] == pytest.approx(0.25)
    assert found['figures']['share_in_tolerance']['value'] == pytest.approx(0.8)
    assert found['figures']['time_s']['low'] < 700 < found['figures']['time_s']['high']
    assert found['volume_cm3'] == pytest.approx(5.0) and found['seeds'] == [0, 1]


def test_cells_differ_in_physics_and_metal_unless_the_job_says_which(parts):
    cells = on_cells(restore(*parts), 6)
    assert [c.seed for c in cells] == list(range(FIRST_CELL, FIRST_CELL + 6))
    assert {c.plant.metal.model for c in cells} == {'portions', 'sections', 'film'}
    assert len({c.plant.metal.transfer for c in cells}) == 6
    assert {c.plant.metal.model for c in on_cells(restore(*parts), 4, ('film',))} == {'film'}
    own = PlantParams()
    assert all(c.plant is own for c in on_cells(restore(*parts, plant=own), 2))
    placed = restore(*parts, overrides={'cell': {'work_zero': (0.2, 0.1, 0.03)}})  # of a cell file
    assert len({c.plant.metal.transfer for c in on_cells(placed, 3)}) == 3
    assert {c.plant.work_zero for c in on_cells(placed, 3)} == {(0.2, 0.1, 0.03)}
    named = restore(*parts, overrides={'cell': {'metal_transfer': 0.9}})
    assert all(c.plant is None for c in on_cells(named, 2))


def test_every_cell_of_a_plan_is_a_kind_of_place():
    """A trough across a block: its ends lie at free sides, its walls at standing metal, a scratch gets no bead."""
    spec = GridSpec(0.0, 0.0, 0.5e-3, 100, 80)
    nominal = np.full(spec.shape, 10e-3)
    nominal[:, :6] = np.nan
    found = nominal.copy()
    found[30:60, :] -= 2e-3
    found[75:78, 20:60] -= 0.5e-3
    plan = plan_restoration(HeightGrid(spec, found), HeightGrid(spec, nominal), PlanSettings())
    kinds = places(plan)
    assert set(np.unique(kinds[plan.region])) >= {0, STANDING, ENDS}
    assert (kinds[plan.region] >= 0).all()
    assert (kinds[76, 25:55] == NOT_LAID).all()
    assert kinds[45, 40] == 0 and kinds[31, 40] in (STANDING, ENDS)
    assert kinds[45, 7] in (FREE, ENDS) and (kinds == FREE).any()
    assert kinds[5, 5] == -1


def maps(error, kinds, below=None) -> LabMaps:
    on = np.ones(np.shape(error), bool)
    spec = GridSpec(0.0, 0.0, 1e-3, *on.shape)
    error = np.array(error)
    return LabMaps(spec, error, on, on, error, np.array(kinds, np.int8), below)


def test_the_squared_error_is_divided_among_level_and_places():
    found = shares([maps([[1e-3, 1e-3, 4e-3, 2e-3]], [[0, 0, FREE, STANDING]])])
    assert sum(found.values()) == pytest.approx(1.0)
    assert list(found)[:2] == [LEVEL, PLACES[FREE]]
    assert found[LEVEL] == pytest.approx(16 / 22) and found[PLACES[FREE]] == pytest.approx(4 / 22)


def test_of_a_machined_part_the_area_below_nominal_counts():
    below = np.array([[True, True, True, False]])
    found = shares([maps([[0.0, 0.0, 0.0, 9.0]], [[NOT_LAID, NOT_LAID, FREE, 0]], below)])
    assert found == {PLACES[NOT_LAID]: pytest.approx(2 / 3), PLACES[FREE]: pytest.approx(1 / 3)}
    assert shares([maps([[0.0]], [[0]], np.array([[False]]))]) == {}


def test_the_command_writes_what_the_report_of_the_job_finds(parts, tmp_path, monkeypatch, capsys):
    monkeypatch.setenv('WAAM_JOBS', str(tmp_path / 'jobs'))
    out = tmp_path / 'out'
    arguments = [parts[0], '--as-found', parts[1], '--layers', 1, '--cells', 1, '--out', out]
    with pytest.raises(SystemExit) as ended:
        raise SystemExit(main(['forecast', *map(str, arguments)]))
    told = capsys.readouterr().out
    found = json.loads((out / 'forecast.json').read_text())
    assert ended.value.code == (1 if found['fails'] else 0)
    assert found['cells'] == 1 and found['verdict'] in told
    assert found['figures']['rms_mm']['low'] < found['figures']['rms_mm']['high']
    assert found['seconds'] > 0 and (out / 'forecast.png').stat().st_size > 5000
    if found['fails']:
        assert found['causes'] and sum(found['causes'].values()) == pytest.approx(1.0)
    goal = restore(*parts, layers=1, jobs_dir=tmp_path / 'jobs').goal
    volume = found['volume_cm3'] * 1e-6
    assert forecasts.find(check(goal), volume)[0] == found
    other, why = forecasts.find(check(goal), 1.5 * volume)
    assert other is None and 'of another wear' in why
    assert forecasts.find(check(replace(goal, tolerance=0.3e-3)), volume) == (None, '')


def test_no_forecast_of_a_damaged_file_is_shown(parts, tmp_path):
    checked = check(restore(*parts, jobs_dir=tmp_path).goal)
    folder = forecasts.folder_of(checked)
    folder.mkdir(parents=True)
    for text in ('{"volume_cm3": ', '[]'):
        forecasts.write(folder, text)
        assert 'cannot be read' in forecasts.find(checked, 1e-6)[1]
    forecasts.write(folder, '{"volume_cm3": null}')
    assert forecasts.find(checked, math.nan)[0] is None


@pytest.mark.parametrize(
    'asked,told',
    [
        (['a.stl', '--as-found', 'w.stl', '--finish', 'machined'], '--finish machined'),
        (['b c.stl', '--mode', 'build', '--set', 'levels=adaptive'], '--set plan.levels=adaptive'),
        (['a.stl', '--scale', '1', '--bead-width', '5', '--out', 'o'], '--bead-width 5.0 --out o'),
        (['a.stl', '--machine', 'robot', '--repair'], '--repair --machine robot'),
        (['a.stl', '--cell', 'big', '--speed', '8'], '--cell big --set plan.speed=0.008'),
        (['a.stl', '--set', 'allowance=0.0005', '--set', 'grid=0.001'], '--allowance 0.5'),
        (
            ['a.stl', '--set', 'strategy=contour', '--overhang', '30'],
            '--set plan.overhang_limit_deg=30.0 --strategy contour',
        ),
        (['w.npz', '--shaft', '80', '--ends', '20'], 'w.npz --shaft 80 --ends 20'),
        (['scan.pcd'], ''),
        (['a.stl', '--as-found', 'w.npz'], ''),
        (['a.stl', '--as-found', 'w.ply', '--zone'], ''),
        (['a.gcode', '--dialect', 'slicer'], ''),
    ],
)
def test_the_command_that_a_plan_names_is_understood(asked, told):
    parser = build_parser()
    said = _forecast(parser.parse_args(['plan', *asked]))
    assert (told in said) if told else said == ''
    if told:
        args = parser.parse_args(shlex.split(said)[1:])
        assert args.command == 'forecast' and args.part == Path(asked[0])


def test_wrong_options_are_refused_by_name(parts, capsys):
    with pytest.raises(SystemExit) as ended:
        raise SystemExit(main(['forecast', *map(str, parts[:1]), '--cells', '0']))
    assert ended.value.code == 2 and '--cells is 0' in capsys.readouterr().err


@pytest.mark.parametrize('option,value', [('--shaft', '0'), ('--shaft', 'nan'), ('--ends', '-1')])
def test_a_shaft_without_a_size_is_refused_by_name(option, value, tmp_path, capsys):
    asked = {'--shaft': '80', '--ends': '20', option: value}
    words = [str(tmp_path / 'worn.npz'), *(w for pair in asked.items() for w in pair)]
    for verb in ('plan', 'lab', 'forecast'):
        try:
            ended = main([verb, *words])
        except SystemExit as stop:
            ended = stop.code
        assert ended == 2 and f'{option} {value}: a length in mm' in capsys.readouterr().err
