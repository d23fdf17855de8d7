"""Layouts: what they change of a job, and which one is taken."""

from __future__ import annotations

import pytest

from waam_lab import layouts, restore
from waam_lab.job import LabResult
from waam_lab.layouts import LAYOUTS, Trial, best, laid, on_cells, options
from waam_sim.plant import PlantParams

ASKED, NARROW, GROWING, BOTH = LAYOUTS


def job(parts, **fields):
    return restore(*parts, tolerance=0.2e-3, **fields)


def trial(layout, *rms, time=700.0, message='') -> Trial:
    verdict = 'failed' if message else 'in_tolerance'
    found = (
        LabResult(k, verdict, 0, message, rms=r, time=time, share_in_tolerance=0.96)
        for k, r in enumerate(rms)
    )
    return Trial(layout, tuple(found))


def test_what_was_asked_for_is_the_first_and_changes_nothing(parts):
    asked = job(parts, bead_width=5.5e-3, plan_settings=('levels=adaptive',))
    assert laid(asked, ASKED) == asked


def test_beads_become_narrower_than_those_of_the_job_or_of_the_material(parts):
    assert laid(job(parts), NARROW).goal.bead_width == pytest.approx(5e-3)
    assert laid(job(parts, bead_width=4.8e-3), NARROW).goal.bead_width == pytest.approx(4e-3)


def test_settings_of_the_job_stay(parts):
    asked = job(parts, plan_settings=('finish_layers=2', 'levels=adaptive'))
    assert laid(asked, BOTH).goal.plan_settings == (
        'finish_layers=2',
        'levels=adaptive',
        'finish_growth=1.2',
    )


def test_the_command_line_says_the_layout(parts):
    assert options(job(parts), ASKED) == []
    words = ['--bead-width', '5', '--set', 'finish_layers=4', '--set', 'finish_growth=1.2']
    assert options(job(parts), BOTH) == words


def test_every_cell_for_choosing_has_physics_of_its_own_unless_the_job_has_some(parts):
    cells = on_cells(job(parts), 3)
    assert len({c.plant.metal.pool_lag for c in cells}) == 3
    assert [c.seed for c in cells] == [layouts.FIRST_CELL + k for k in range(3)]
    own = PlantParams()
    assert all(c.plant is own for c in on_cells(job(parts, plant=own), 2))
    named = job(parts, overrides={'cell': {'metal_transfer': 0.9}})
    assert all(c.plant is None for c in on_cells(named, 2))
    with pytest.raises(ValueError, match='at least one cell'):
        on_cells(job(parts), 0)


def test_the_least_error_is_taken_when_it_is_clearly_less():
    asked = trial(ASKED, 0.10e-3, 0.12e-3)
    better = trial(NARROW, 0.09e-3, 0.11e-3)
    assert best([asked, better]) is better
    assert best([asked, trial(NARROW, 0.109e-3, 0.109e-3)]) is asked  # 1 % less is no reason


def test_a_layout_that_takes_much_longer_or_failed_is_not_taken():
    asked = trial(ASKED, 0.12e-3)
    assert best([asked, trial(NARROW, 0.05e-3, time=900.0)]) is asked
    assert best([asked, trial(NARROW, 0.05e-3, message='E401')]) is asked
    failed = trial(ASKED, 0.12e-3, message='E401')
    other = trial(GROWING, 0.3e-3)
    assert best([failed, other]) is other
    with pytest.raises(ValueError, match='E401'):
        best([failed])
