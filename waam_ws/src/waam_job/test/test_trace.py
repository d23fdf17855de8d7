"""What a report must be traceable to, and that it says what nobody told."""

from __future__ import annotations

import csv
import hashlib
import json
from dataclasses import replace

import numpy as np
import pytest

from waam_job.model.records import State


def report(folder) -> dict:
    return json.loads((folder.path / 'report.json').read_text())


@pytest.fixture
def done(make_cell, make_runner, tmp_path):
    """(report, folder, cell) of a job with everything that can be traced."""
    cell = make_cell()
    cell.machine_state = replace(
        cell.machine_state, identity='WAAM_CONTROLLER_V1', firmware='1.2', port='/dev/x'
    )
    file = tmp_path / 'scanner.yaml'
    file.write_text("date: '2026-11-20T00:00:00+00:00'\nsha256: abcd\nartefact: block 3\n")
    cell.node_parameters = {'scan_fusion': {'calibration': str(file), 'mount_xyz': [0.1, 0.0, 0.0]}}
    inner = cell.correct
    cell.correct = lambda *a: replace(inner(*a), model_hash='f00d')
    runner, _, folder = make_runner(
        cell,
        settings={'calibration_max_days': 0.0},
        operator_name='J. Fitter',
        notes=('wire_lot=4711', 'gas=M21', 'wire_lot=4712'),
    )
    folder.write_yaml(
        'job.yaml', {'part_sha256': '12', 'software': 'abc', 'packages': {'numpy': '2'}}
    )
    assert runner.run().state == State.DONE
    return report(folder), folder, cell


def test_report_traces_people_material_software_calibration_and_models(done):
    found, folder, _ = done
    trace = found['trace']
    assert (trace['operator'], trace['wire_lot'], trace['gas']) == ('J. Fitter', '4712', 'M21')
    assert trace['not_told'] == []
    assert trace['software']['software'] == 'abc' and trace['part_sha256'] == '12'
    assert trace['controller'] == {
        'identity': 'WAAM_CONTROLLER_V1',
        'firmware': '1.2',
        'port': '/dev/x',
    }
    c = trace['calibration']
    assert c['sha256'] == 'abcd' and c['artefact'] == 'block 3' and c['age_days'] > 0
    assert c['mounting']['mount_xyz'] == [0.1, 0.0, 0.0]
    layers = [r['layer'] for r in found['closed_loop']['layers'] if not r['final']]
    assert trace['models'] == {'f00d': layers}
    program = (folder.path / 'program.gcode').read_bytes()
    assert trace['programs']['program.gcode']['sha256'] == hashlib.sha256(program).hexdigest()


def test_what_nobody_told_is_named(make_cell, make_runner):
    runner, _, folder = make_runner(make_cell())
    runner.run()
    trace = report(folder)['trace']
    assert trace['not_told'] == ['operator', 'wire_lot', 'gas']
    assert trace['calibration']['file'] == '' and trace['models'] == {}


def test_every_layer_says_what_the_standard_asks_for(done):
    for row in done[0]['closed_loop']['layers']:
        for key in (
            'current_mean', 'voltage_mean', 'wire_feed_mean', 'travel_speed_mean', 'heat_input', 'temperature',
            'height_error_rms', 'height_error_max', 'psi_mean', 'k_gain', 'flow_factor', 'clamps_speed',
            'clamps_feed', 'clamps_voltage', 'clamps_psi', 'faults', 'duration', 'wait', 'law',
        ):  # fmt: skip
            assert key in row, key


def test_tolerance_map_holds_every_judged_cell(done):
    found, folder, _ = done
    run = found['closed_loop']
    about = run['tolerance_map']
    with open(folder.path / about['file']) as f:
        rows = list(csv.DictReader(f))
    last = dict(np.load(sorted((folder.path / 'layers').glob('*.npz'))[-1]))
    assert about['cells'] == last['interior'].sum()
    judged = [r for r in rows if r['judged'] == '1']
    assert len(rows) == last['region'].sum() and len(judged) == about['cells']
    inside = sum(r['deviation_mm'] != '' and abs(float(r['deviation_mm'])) <= 0.2 for r in judged)
    assert inside / len(judged) == pytest.approx(run['share_in_tolerance'], abs=1e-3)
    assert about['in_tolerance'] + about['above'] + about['below'] + about['unseen'] == len(judged)
    errors = np.array([float(r['deviation_mm']) for r in judged if r['deviation_mm']])
    assert np.sqrt(np.mean(errors**2)) == pytest.approx(run['rms_mm'], rel=1e-3)


def test_job_that_never_scanned_has_no_tolerance_map(make_cell, make_runner):
    cell = make_cell()
    cell.machine_state = replace(cell.machine_state, connected=False)
    runner, _, folder = make_runner(cell)
    runner.run()
    assert report(folder)['closed_loop']['tolerance_map'] is None
