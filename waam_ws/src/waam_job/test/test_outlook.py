"""A loop whose error grows from layer to layer is paused in time; one that converges is left alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from waam_job.model.outlook import diverges, lost, starved, too_much, worst_region
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
    told = [a for a in cell.anomalies if 'a region grows by' in a.text]
    assert told and told[0].severity == 'FAULT' and told[0].class_name == 'height'
    assert told[0].layer <= 2 and 'mm at x' in told[0].text and 'narrower beads' in told[0].text
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
    told = [a.text for a in cell.anomalies if 'a region grows by' in a.text]
    assert told and 'override is in force (speed 50%, wire 120%: 2.40 x the metal)' in told[0]


@pytest.mark.parametrize(
    'deep_mm,reaction',
    [
        (1.1, 'within what the 3 layers left can correct, more than the next one can'),
        (4.0, 'more than the 3 layers left can correct'),
    ],
)
def test_an_error_is_promised_only_to_layers_that_can_correct_it(
    deep_mm, reaction, make_cell, make_runner
):
    cell = make_cell()
    inner = cell.finish_scan

    def pit(*args):
        scan = inner(*args)
        if any(s.arc for s in cell.executed):
            z = scan.map.z.copy()
            rows, cols = (n // 2 for n in z.shape)
            z[rows, cols] = runner.context.program.target_after(1)[rows, cols] - deep_mm * 1e-3
            scan = replace(scan, map=scan.map.with_z(z))
        return scan

    cell.finish_scan = pit
    runner = make_runner(cell, layer_height=1e-3, plan_settings=('finish_layers=0',))[0]
    runner.run()
    told = [a for a in cell.anomalies if 'after layer 1' in a.text]
    assert len(told) == 1 and f'-{deep_mm:.2f} mm' in told[0].text
    assert told[0].reaction == reaction
    assert np.isfinite(told[0].position).all()


BEAD = 12  # cells


def disc(shape, row, col, radius):
    rows, cols = np.ogrid[: shape[0], : shape[1]]
    return (rows - row) ** 2 + (cols - col) ** 2 <= radius**2


def test_a_region_that_gets_no_metal_is_found_and_scatter_is_not():
    rng = np.random.default_rng(3)
    on = disc((100, 100), 50, 50, 45)
    asked = [np.where(on, 2e-3, 0.0)] * 2
    grown = [a * (1 + 0.25 * rng.normal(size=on.shape)) for a in asked]
    assert not starved(grown, asked, on, BEAD).any()
    hole = disc(on.shape, 40, 60, 10)
    poor = starved([np.where(hole, 0.3 * g, g) for g in grown], asked, on, BEAD)
    assert poor[hole].mean() > 0.6 and not poor[~disc(on.shape, 40, 60, 16)].any()
    once = [np.where(hole, 0.3 * grown[0], grown[0]), np.where(hole, 1.5 * grown[1], grown[1])]
    assert not starved(once, asked, on, BEAD).any()  # the second layer has made up for it
    scratch = disc(on.shape, 40, 60, 3)  # narrower than a bead
    assert not starved([np.where(scratch, 0.0, g) for g in grown], asked, on, BEAD).any()
    unseen = [np.where(hole, np.nan, g) for g in grown]
    assert not starved(unseen, asked, on, BEAD).any()
    thin = [np.where(hole, 0.2e-3, a) for a in asked]  # hardly anything was asked for there
    assert not starved([np.where(hole, 0.0, g) for g in grown], thin, on, BEAD).any()


def test_the_worst_region_is_that_of_the_rim_and_not_a_single_cell():
    on = disc((100, 100), 50, 50, 40)
    rim = on & ~disc(on.shape, 50, 50, 36)
    error = np.where(rim, -1e-3, 0.0)
    assert 0.4e-3 < worst_region(error, on, BEAD) < 1e-3
    spike = np.zeros(on.shape)
    spike[50, 50] = 5e-3
    assert worst_region(spike, on, BEAD) < 0.05e-3


@pytest.mark.parametrize(
    'error_mm,rest_mm,out',
    [
        (0.7, 2.0, False),  # 0.2 mm and 0.4 x 2 mm
        (-1.1, 2.0, True),
        (1.1, 2.0, True),
        (-0.3, 0.0, True),  # nothing more is laid there
    ],
)
def test_what_all_layers_to_come_cannot_correct_is_lost(error_mm, rest_mm, out):
    found = lost(np.array([error_mm * 1e-3]), np.array([rest_mm * 1e-3]), TOLERANCE)
    assert found[0] == out


def test_a_job_is_given_up_only_when_clearly_too_much_is_lost():
    judged = np.ones(1000, bool)
    assert not too_much(np.arange(1000) < 95, judged, 0.95)
    assert too_much(np.arange(1000) < 105, judged, 0.95)
    assert not too_much(judged, ~judged, 0.95)  # nothing is judged


def test_growth_from_a_map_that_is_not_believed_starves_nobody(make_cell, make_runner):
    """The scan after layer 1 stands 3 mm too high and is not plausible: growth from it would be none."""
    cell = make_cell()
    runner, _, _ = make_runner(cell, layer_height=1e-3, plan_settings=('finish_layers=0',))
    inner, begin, layers = cell.finish_scan, cell.begin_scan, [0]

    def begun(job_id, layer, spec, laid):
        layers[0] = layer
        return begin(job_id, layer, spec, laid)

    def finish(*args):
        scan = inner(*args)
        if layers[0] != 1:
            return scan
        return replace(
            scan, map=scan.map.with_z(scan.map.z + 3e-3), plausible=False, reasons=('jump',)
        )

    cell.begin_scan, cell.finish_scan = begun, finish
    assert runner.run().state == State.DONE
    assert not [a for a in cell.anomalies if 'a region grows' in a.text]


@pytest.mark.parametrize('which', ['starved', 'lost'])
def test_the_job_pauses_when_metal_is_missing(which, make_cell, make_runner):
    """No metal arrives in the middle of the part; or a lump as high as all layers together lies there."""
    cell = make_cell()
    runner, control, _ = make_runner(cell, layer_height=1e-3, plan_settings=('finish_layers=0',))
    inner, laid = cell.finish_scan, []

    def finish(*args):
        scan = inner(*args)
        if not laid:
            laid.append(scan.map.z.copy())
        elif which == 'starved':
            middle = disc(scan.map.spec.shape, *(n // 2 for n in scan.map.spec.shape), 8)
            cell_z = scan.map.z
            cell_z = np.where(middle, laid[0] + 0.2 * (cell_z - laid[0]), cell_z)
            return replace(scan, map=scan.map.with_z(cell_z))
        else:
            middle = disc(scan.map.spec.shape, *(n // 2 for n in scan.map.spec.shape), 14)
            return replace(scan, map=scan.map.with_z(scan.map.z + 4e-3 * middle))
        return scan

    cell.finish_scan = finish
    wait = cell.wait
    cell.wait = lambda s: (wait(s), control.paused and control.abort('enough'))
    assert runner.run().state == State.ABORTED
    told = [a for a in cell.anomalies if a.severity == 'FAULT' and a.class_name == 'height']
    words = {
        'starved': ('a region grows by', 'mm2', 'overhang, arc, wire'),
        'lost': ('cannot be brought to its target any more', 'more to come'),
    }[which]
    assert len(told) == 1 and all(w in told[0].text for w in words)
    assert told[0].layer <= 2 and 'mm at x' in told[0].text and 'waam forecast' in told[0].text
    assert told[0].reaction == 'arc ended, machine held, job paused'
