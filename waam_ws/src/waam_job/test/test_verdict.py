"""A verdict over no judged grid cells is its own: neither in tolerance nor out of it, with the reason."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from waam_job.model.geometry import NOTHING_SEEN, deviation
from waam_job.model.overrun import Overrun
from waam_job.model.records import State
from waam_job.model.verdict import Verdict

TOLERANCE = 0.2e-3
ON = np.ones((4, 5), bool)


def verdict_over(error, interior) -> Verdict:
    return Verdict(0.95, TOLERANCE, deviation(error, ON, interior, TOLERANCE))


def test_a_region_without_an_interior_is_not_judged():
    verdict = verdict_over(np.zeros(ON.shape), ~ON)
    assert verdict.word.startswith('not judged: all of the region belongs to its rim')
    assert not verdict.in_tolerance and verdict.text == verdict.word


def test_an_interior_that_nobody_has_seen_is_not_judged():
    verdict = verdict_over(np.full(ON.shape, np.nan), ON)
    assert verdict.word == 'not judged: the last scan has seen nothing of the judged area'
    assert np.isnan(verdict.final.share_in_tolerance) and verdict.final.cells == 20


@pytest.mark.parametrize(
    'error,word', [(1e-4, 'in tolerance'), (-1e-4, 'in tolerance'), (3e-4, 'out of tolerance')]
)
def test_what_was_seen_is_judged(error, word):
    verdict = verdict_over(np.full(ON.shape, error), ON)
    assert verdict.word == word and 'RMS' in verdict.text
    assert verdict.in_tolerance == (word == 'in tolerance')


def test_unseen_places_among_seen_ones_count_against_it():
    error = np.zeros(ON.shape)
    error[0, 0] = np.nan
    verdict = verdict_over(error, ON)
    assert verdict.final.share_in_tolerance == pytest.approx(19 / 20)
    assert verdict_over(error, ON).in_tolerance
    error[0, 1] = np.nan
    assert verdict_over(error, ON).word == 'out of tolerance'


def test_the_rim_has_a_verdict_of_its_own():
    inner = ON.copy()
    inner[0] = False
    error = np.where(inner, 1e-4, 5e-4)
    verdict = verdict_over(error, inner)
    assert (verdict.word, verdict.word_all) == ('in tolerance', 'out of tolerance')
    assert verdict.final.share_in_tolerance == 1.0
    assert verdict.final.share_all == pytest.approx(0.75)
    assert 'with the rim' in verdict.text and 'out of tolerance' in verdict.text


def test_overrun_is_told_where_the_part_has_sides():
    verdict = verdict_over(np.zeros(ON.shape), ON)
    assert 'over the sides' not in verdict.text
    over = replace(verdict, overrun=Overrun(0.4e-3, 1.7e-3))
    assert over.text.endswith('1.7 mm over the sides')


def test_a_job_that_did_not_end_has_failed():
    assert Verdict(0.95, TOLERANCE).word == Verdict(0.95, TOLERANCE).word_all == 'failed'
    assert Verdict(0.95, TOLERANCE, NOTHING_SEEN).word.startswith('not judged')


def test_status_and_report_of_a_job_say_why_it_was_not_judged(make_cell, make_runner):
    cell = make_cell()
    runner, _, folder = make_runner(cell, layers=1)
    inner = cell.finish_scan

    def blind_after_the_layer(*args):
        scan = inner(*args)
        if any(s.arc for s in cell.executed):
            scan = replace(scan, map=scan.map.with_z(np.full(scan.map.z.shape, np.nan)))
        return scan

    cell.finish_scan = blind_after_the_layer
    status = runner.run()
    assert status.state == State.DONE
    assert status.message == 'not judged: the last scan has seen nothing of the judged area'
    assert not runner.in_tolerance
    report = json.loads((folder.path / 'report.json').read_text())
    assert report['verdict'] == report['closed_loop']['verdict'] == status.message
    assert report['verdict_with_rim'] == status.message
    assert report['closed_loop']['share_in_tolerance'] is None
    assert report['closed_loop']['share_all_in_tolerance'] is None
    assert report['closed_loop']['tolerance_map']['unseen'] > 0
