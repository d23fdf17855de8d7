"""A scan that is not the one that was asked for ends the job; one in which the surface beside the layer has moved is
taken again, and told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from waam_job.conversions import heat_from_msg
from waam_job.model.goal import Code
from waam_job.model.records import State
from waam_msgs.msg import HeatFactor


def after_the_layer(cell, change):
    """`change` of every scan once metal was laid."""
    inner = cell.finish_scan

    def finish(*args):
        scan = inner(*args)
        return change(scan) if any(s.arc for s in cell.executed) else scan

    cell.finish_scan = finish


def moved_grid(scan):
    spec = replace(scan.map.spec, origin_x=scan.map.spec.origin_x + 5e-3)
    return replace(scan, map=replace(scan.map, spec=spec))


@pytest.mark.parametrize(
    'change,words',
    [
        (lambda s: replace(s, job_id='another'), "of job 'another'"),
        (lambda s: replace(s, layer=7), 'taken after layer 7, asked for was one after layer 1'),
        (lambda s: replace(s, stamp=3.0), 'older than the request'),
        (moved_grid, 'its grid is'),
    ],
)
def test_a_scan_of_something_else_is_refused_by_name(change, words, make_cell, make_runner):
    cell = make_cell()
    after_the_layer(cell, change)
    status = make_runner(cell)[0].run()
    assert status.state == State.FAILED and status.error_code == Code.SCAN_FAILED
    assert words in status.message


@pytest.mark.parametrize('offset', [0.3e-3, -0.25e-3, 4e-3])
@pytest.mark.parametrize('lasting', [True, False])
def test_a_surface_that_moved_is_scanned_again_and_told(offset, lasting, make_cell, make_runner):
    cell, left = make_cell(), [10**6 if lasting else 1]

    def lifted(scan):
        left[0] -= 1
        return scan if left[0] < 0 else replace(scan, map=scan.map.with_z(scan.map.z + offset))

    after_the_layer(cell, lifted)
    assert make_runner(cell, layers=1)[0].run().state == State.DONE
    told = [a for a in cell.anomalies if 'beside the layer moved' in a.text]
    assert all(f'{offset * 1e3:+.2f} mm' in a.text and a.severity == 'WARNING' for a in told)
    reactions = ['scanned again', 'two scans agree: taken as it is'][: 2 if lasting else 1]
    assert [a.reaction for a in told] == reactions


def test_a_surface_that_stays_is_not_scanned_again(make_cell, make_runner):
    cell = make_cell()
    after_the_layer(cell, lambda s: replace(s, map=s.map.with_z(s.map.z + 0.03e-3)))
    assert make_runner(cell)[0].run().state == State.DONE
    assert not [a for a in cell.anomalies if 'beside the layer' in a.text]


@pytest.mark.parametrize(
    'field,value',
    [('temperature', 2500.0), ('temperature', -300.0), ('temperature', np.nan), ('factor', 0.0),
     ('factor', 5.0), ('factor', np.nan), ('factor', np.inf)],
)  # fmt: skip
def test_heat_that_cannot_be_is_not_plausible(field, value):
    message = HeatFactor(factor=0.9, temperature=150.0, ready=True, plausible=True)
    assert heat_from_msg(message).plausible and heat_from_msg(message).ready
    setattr(message, field, float(value))
    heat = heat_from_msg(message)
    assert not heat.plausible and not heat.ready
    assert field in heat.reasons[-1] or 'heat factor' in heat.reasons[-1]
