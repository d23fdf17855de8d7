"""A loop whose error grows from layer to layer is paused in time; one that converges is left alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from waam_job.model.outlook import diverges
from waam_job.model.records import State

TOLERANCE, LAYER = 0.2e-3, 2e-3


@pytest.mark.parametrize(
    'rms_mm,told',
    [
        ((0.35, 0.63, 0.74), True),  # a cone that opens: each layer sinks further
        ((0.43, 0.67, 0.78), True),  # a thin blade
        ((0.21, 0.36, 0.45), False),  # grows, but within what a loop brings back
        ((0.9, 0.7, 0.65), False),
        ((0.6, 0.9), False),  # one layer is no trend
        ((0.8, 0.9, 0.91), False),
    ],
)
def test_a_trend_is_told_from_scatter(rms_mm, told):
    assert diverges([v * 1e-3 for v in rms_mm], TOLERANCE, LAYER) is told


@given(st.lists(st.floats(1e-6, 0.59e-3), max_size=30))
def test_errors_that_a_loop_brings_back_are_never_told(rms):
    assert not diverges(rms, TOLERANCE, LAYER)


@given(st.floats(0.61e-3, 5e-3), st.floats(1.06, 3.0), st.integers(3, 10))
def test_steady_growth_is_told_after_two_layers(first, factor, layers):
    rms = [first * factor**i for i in range(layers)]
    assert diverges(rms, TOLERANCE, LAYER)
    assert not diverges(rms[::-1], TOLERANCE, LAYER)


def sinking(cell, per_layer):
    """Every scan shows the middle of the part lower than it is, by so much more after each layer."""
    inner, begin, layers = cell.finish_scan, cell.begin_scan, [0]

    def begun(job_id, layer, spec, laid):
        layers[0] = layer
        return begin(job_id, layer, spec, laid)

    def finish(*args):
        scan = inner(*args)
        z = scan.map.z.copy()
        middle = tuple(slice(n // 3, n - n // 3) for n in z.shape)
        z[middle] -= per_layer * layers[0] ** 2
        return replace(scan, map=scan.map.with_z(z))

    cell.begin_scan = begun

    cell.finish_scan = finish


@pytest.mark.parametrize('resumed', [True, False])
def test_the_job_pauses_with_figures_place_and_remedy(resumed, make_cell, make_runner):
    cell = make_cell()
    sinking(cell, 0.8e-3)
    runner, control, _ = make_runner(cell, layer_height=1e-3, plan_settings=('finish_layers=0',))
    inner, waits = cell.wait, [0]

    def wait(seconds):
        inner(seconds)
        if control.paused:
            waits[0] += 1
            if waits[0] % 20 == 0:
                control.resume() if resumed else control.abort('enough')

    cell.wait = wait
    status = runner.run()
    assert status.state == (State.DONE if resumed else State.ABORTED)
    told = [a for a in cell.anomalies if 'grows from layer to layer' in a.text]
    assert told and told[0].severity == 'FAULT' and told[0].class_name == 'height'
    assert told[0].layer <= 3 and 'mm at x' in told[0].text and 'narrower beads' in told[0].text
    assert told[0].reaction == 'arc ended, machine held, job paused'
    assert any(s.state == State.PAUSED and 'resume or abort' in s.message for s in cell.statuses)
    if resumed:  # asked again only after as many layers more
        assert all(b.layer - a.layer >= 2 for a, b in zip(told, told[1:], strict=False))


def test_an_override_in_force_is_the_first_cause_that_is_named(make_cell, make_runner):
    cell = make_cell()
    sinking(cell, 0.8e-3)
    runner, control, _ = make_runner(cell, layer_height=1e-3, plan_settings=('finish_layers=0',))
    control.override(0.5, 1.2)
    inner = cell.wait
    cell.wait = lambda s: (inner(s), control.paused and control.abort('enough'))
    runner.run()
    told = [a.text for a in cell.anomalies if 'grows from layer to layer' in a.text]
    assert told and 'override is in force (speed 50%, wire 120%: 2.40 x the metal)' in told[0]


def test_a_large_error_is_not_promised_to_the_next_layer(make_cell, make_runner):
    cell = make_cell()
    inner = cell.finish_scan

    def pit(*args):
        scan = inner(*args)
        if any(s.arc for s in cell.executed):
            z = scan.map.z.copy()
            rows, cols = (n // 2 for n in z.shape)
            z[rows, cols] -= 4e-3
            scan = replace(scan, map=scan.map.with_z(z))
        return scan

    cell.finish_scan = pit
    make_runner(cell)[0].run()
    told = [
        a for a in cell.anomalies if a.class_name == 'height' and '-4.' in a.text or '-3.' in a.text
    ]
    assert told and told[0].reaction == 'more than the next layer can correct'
    assert np.isfinite(told[0].position).all()
