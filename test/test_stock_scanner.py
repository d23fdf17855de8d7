"""A whole job through real processes with a scanner as stock drivers are (`stock_scanner_cell`)."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from waam_bringup.graph import Settings, processes
from waam_node.testing import fresh_domain

RATE = 8.0  # simulated seconds per second: 400 clouds a second
CELL = Path(__file__).with_name('stock_scanner_cell.py')


@pytest.fixture
def bench(tmp_path, graph_in, part):
    domain, run = fresh_domain(), tmp_path / 'run'
    run.mkdir()
    like = Settings(run=run, seed=3, preset='gentle', rate=RATE)
    arguments = next(p for p in processes(like) if p.name == 'cell').command[1:]
    with open(tmp_path / 'cell.log', 'w') as log:
        cell = subprocess.Popen(
            [sys.executable, str(CELL), *arguments], env=os.environ | {'ROS_DOMAIN_ID': str(domain)},
            stdout=log, stderr=log,
        )  # fmt: skip
        try:
            with graph_in(tmp_path, part, domain=domain, rate=RATE, without=('cell',)) as b:
                yield b
        finally:
            cell.terminate()
            cell.wait(20)


def test_a_job_needs_no_enable_and_takes_clouds(bench):
    result = bench.job(loop_mode='closed_loop', layers=2)
    assert result.error_code == 0, result.message
    folder = Path(result.job_dir)
    run = json.loads((folder / 'report.json').read_text())['closed_loop']
    assert run['as_found_rms_mm'] > 2.0 and run['rms_mm'] < 0.35
    assert [r for r in run['layers'] if r.get('correction_applied')]
    scans = sorted((folder / 'layers').glob('*.npz'))
    assert len(scans) == 3
    for scan in scans:
        assert np.isfinite(np.load(scan)['z']).mean() > 0.85  # all but the steep sides
