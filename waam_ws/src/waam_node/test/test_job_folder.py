"""Names inside a job folder sort and read back."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from waam_node import job_folder


def test_maps_are_found_in_the_order_of_their_layers(tmp_path: Path):
    (tmp_path / job_folder.MAPS).mkdir()
    for layer in (2, 0, 1000, 11):
        (tmp_path / job_folder.map_after(layer)).touch()
    (tmp_path / job_folder.MAPS / 'scan_old.npz').touch()
    found = job_folder.map_files(tmp_path)
    assert [job_folder.layer_of(f) for f in found] == [0, 2, 11, 1000]
    with pytest.raises(ValueError, match=r'scan_x\.npz'):
        job_folder.layer_of(Path('scan_x.npz'))


def test_records_are_found_in_the_order_of_their_runs(tmp_path: Path):
    for run in (2, 10, 1):
        (tmp_path / job_folder.record(run)).mkdir()
    (tmp_path / job_folder.RECORDS).touch()
    (tmp_path / 'record_of_mine').mkdir()
    assert [f.name for f in job_folder.record_folders(tmp_path)] == ['record', 'record_2', 'record_10']  # fmt: skip


def test_a_run_knows_its_job():
    assert job_folder.job_of(job_folder.run_id('20260101T000000Z_a.r2b', 1)) == '20260101T000000Z_a.r2b'  # fmt: skip
    assert job_folder.job_of(job_folder.run_id('20260101T000000Z_a', 3)) == '20260101T000000Z_a'


def test_only_later_ones_have_a_number():
    assert (job_folder.plan(), job_folder.plan(2)) == ('plan.npz', 'plan_2.npz')
    assert (job_folder.program(), job_folder.program(3)) == ('program.gcode', 'program_3.gcode')
    assert job_folder.viewer_recording(2) == 'job_2.rrd'


def test_nobody_else_writes_down_these_names():
    files = '|'.join(re.escape(n) for n in (job_folder.JOB, job_folder.STATUS, job_folder.RECORDS,
             job_folder.REPORT, job_folder.REPORT_PAGE, job_folder.CHECKPOINT, job_folder.TELEMETRY))  # fmt: skip
    names = re.compile(rf"""['"]({files})['"]|/scan_\{{""")
    packages = Path(job_folder.__file__).resolve().parents[2]
    campaign = packages / 'waam_lab/waam_lab/report.py'  # its report.json is no job's
    for package in ('job', 'panel', 'view', 'bringup', 'record', 'archive', 'lab'):
        for file in (packages / f'waam_{package}' / f'waam_{package}').glob('**/*.py'):
            if file == campaign:
                continue
            found = names.search(file.read_text())
            assert not found, f'{file}: {found.group(0)}'
