"""Layouts: what they change of a job, and which one is taken."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest

from waam_lab import build, restore
from waam_lab.job import LabResult
from waam_lab.layouts import ASKED, OTHERS, Trial, best, laid, options, others

MACHINED, NARROW, PARALLEL, BOTH = OTHERS


def job(parts, **fields):
    return restore(*parts, tolerance=0.2e-3, **fields)


def trial(layout, *rms, time=700.0, message='', good=0, stock=math.nan) -> Trial:
    """good: so many of its jobs succeed; stock: m, of finish machined."""
    words = ('cleans up', 'does not clean up')
    if not stock > 0:
        words = ('in tolerance', 'out of tolerance')
    clean = 0.99 if stock > 0 else math.nan
    found = (
        LabResult(
            k,
            'failed' if message else words[k >= good],
            0,
            message,
            rms=r,
            time=time,
            stock_mean=stock,
            clean_share=clean,
        )
        for k, r in enumerate(rms)
    )
    return Trial(layout, tuple(found))


def test_what_was_asked_for_changes_nothing(parts):
    asked = job(parts, bead_width=5.5e-3, plan_settings=('levels=adaptive',))
    assert laid(asked, ASKED) == asked


def test_beads_become_narrower_than_those_of_the_job_or_of_the_material(parts):
    assert laid(job(parts), NARROW).goal.bead_width == pytest.approx(4.2e-3)
    assert laid(job(parts, bead_width=5e-3), NARROW).goal.bead_width == pytest.approx(3.5e-3)


def test_settings_of_the_job_stay(parts):
    asked = job(parts, strategy='contour', plan_settings=('finish_layers=2', 'levels=adaptive'))
    found = laid(asked, BOTH).goal
    assert found.strategy == 'contour' and found.bead_width == pytest.approx(4.5e-3)
    assert found.plan_settings == asked.goal.plan_settings
    assert laid(asked, MACHINED).goal.plan_settings == (
        'finish_layers=2',
        'levels=adaptive',
        'finish=machined',
    )


def test_only_layouts_that_the_job_can_have_are_tried(parts):
    assert others(job(parts)) == OTHERS
    machined = job(parts, plan_settings=('finish=machined',))
    assert MACHINED not in others(machined) and MACHINED not in others(build(parts[0]))
    assert MACHINED not in others(job(parts, allowance=0.5e-3))
    chosen = others(job(parts, strategy='contour'))
    assert PARALLEL not in chosen and BOTH not in chosen and NARROW in chosen
    program = job(parts)
    assert others(replace(program, goal=replace(program.goal, program=Path('a.gcode')))) == ()


def test_the_command_line_says_the_layout(parts):
    assert options(job(parts), ASKED) == []
    assert options(job(parts), BOTH) == ['--bead-width', '4.5', '--strategy', 'zigzag']
    assert options(job(parts), PARALLEL) == ['--strategy', 'zigzag']
    assert options(job(parts, plan_settings=('levels=adaptive',)), MACHINED) == [
        '--finish',
        'machined',
    ]


def test_a_layout_that_succeeds_more_often_is_taken_as_laid_before_machined():
    asked = trial(ASKED, 0.3e-3, 0.3e-3)
    machined = trial(MACHINED, 0.3e-3, 0.3e-3, good=2, stock=0.6e-3)
    narrow = trial(NARROW, 0.2e-3, 0.2e-3, good=1)
    assert best(asked, [machined, narrow]) is machined
    sure = trial(PARALLEL, 0.2e-3, 0.2e-3, good=2)
    assert best(asked, [machined, narrow, sure]) is sure


def test_where_none_succeeds_the_least_error_counts_when_it_is_clearly_less():
    asked = trial(ASKED, 0.30e-3, 0.32e-3)
    better = trial(NARROW, 0.29e-3, 0.29e-3)
    assert best(asked, [better, trial(PARALLEL, 0.31e-3, 0.30e-3)]) is better
    assert best(asked, [trial(NARROW, 0.305e-3, 0.305e-3)]) is None  # 2 % less is no reason
    assert best(asked, [trial(MACHINED, 0.1e-3, 0.1e-3, stock=0.5e-3)]) is None  # not the same RMS


def test_a_layout_that_failed_is_not_taken():
    asked = trial(ASKED, 0.3e-3)
    assert best(asked, [trial(NARROW, 0.05e-3, message='E401')]) is None
    failed = trial(ASKED, 0.3e-3, message='E401')
    other = trial(PARALLEL, 0.5e-3)
    assert best(failed, [other]) is other
