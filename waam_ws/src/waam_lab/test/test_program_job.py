"""A small program of others through a whole job in the laboratory: its path stays, its setpoints are corrected."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
import yaml

from waam_job.model.goal import Code, JobError, JobGoal, check
from waam_lab import run
from waam_lab.cell import LabCell
from waam_lab.job import LabJob
from waam_lab.watch import LayerWatch
from waam_node import job_folder
from waam_plan.gcode.store import load_plan
from waam_plan.import_gcode.level_metal import RATIO_HIGH
from waam_process.segment import Kind, Segment


def pad(layers: int = 2) -> str:
    """Five beads of 24 mm, 4 mm apart, to and fro, in the manner of a printer's slicer."""
    text = ['G21', 'G90', 'M83', 'G28', 'M104 S0']
    for k in range(layers):
        text += ['; a comment', ';LAYER_CHANGE', f'G1 Z{2 * (k + 1)} F3000', 'G1 X40 Y40 F3000']
        text += ['G1 F600']
        for i in range(5):
            x = 64 if i % 2 == 0 else 40
            text += [f'G1 X{x} Y{40 + 4 * i} E{24 * 7.6:.4f}']
            text += [f'G1 X{x} Y{44 + 4 * i} E{4 * 7.6:.4f}'] if i < 4 else []
    return '\n'.join([*text, 'M107', 'M84'])


@pytest.fixture
def goal(tmp_path) -> JobGoal:
    program, part = tmp_path / 'pad.gcode', tmp_path / 'pad.stl'
    program.write_text(pad())
    box = trimesh.creation.box(extents=(22, 16, 4))
    box.apply_translation((52, 48, 2))
    box.export(part)
    return JobGoal(
        part=part,
        material='er70s-6',
        jobs_dir=tmp_path / 'jobs',
        mode='build',
        program=program,
        dialect='slicer',
    )


@pytest.fixture
def sent_in(monkeypatch) -> dict[int, list[Segment]]:
    """What is sent to the machine by layer; 0 = outside of layers."""
    layers, enqueue = defaultdict(list), LabCell.enqueue

    def noted(cell, job_id, segments, last):
        enqueue(cell, job_id, segments, last)
        for s in segments:
            layers[s.layer].append(s)

    monkeypatch.setattr(LabCell, 'enqueue', noted)
    return layers


def test_a_program_is_laid_in_closed_loop_and_its_path_stays(goal, sent_in):
    watch = LayerWatch()
    result = run(LabJob(goal, seed=3, keep=True), watch)
    assert result.error_code == 0, result.message
    assert result.layers == 2 and result.fallbacks == 0
    plan = load_plan(result.folder / job_folder.plan())
    for layer in plan.layers:
        sent = [s for s in sent_in[layer.number] if s.kind == Kind.DEPOSIT]
        assert [(s.start, s.end) for s in sent] == [(s.start, s.end) for s in layer.deposits]
    second = [s for s in sent_in[2] if s.kind == Kind.DEPOSIT]
    assert any(abs(s.speed - 0.01) > 1e-4 for s in second)  # corrected
    assert {round(s.speed_programmed, 6) for s in second} == {0.01}
    kept = result.folder / job_folder.PROGRAM_GIVEN
    assert kept.read_text() == goal.program.read_text()
    facts = yaml.safe_load((result.folder / job_folder.JOB).read_text())
    assert len(facts['program_sha256']) == 64 and facts['goal']['dialect'] == 'slicer'
    assert (result.folder / job_folder.PROGRAM_DIALECT).read_text().startswith('# Programs of')
    assert abs(result.layer_means[-1]) < 0.3e-3
    assert [w.request.ratio_high for w in watch.layers] == [RATIO_HIGH, RATIO_HIGH]
    second = watch.layers[1].request
    told = [w.request.next_thickness for w in watch.layers]
    assert told == pytest.approx([np.median(second.planned[second.footprint]), 0.0], rel=1e-5)


def test_without_a_nominal_part_a_program_is_watched_only(goal, sent_in):
    bare = replace(goal, part=Path(''), loop_mode='monitor', layers=1)
    result = run(LabJob(bare, seed=3))
    assert result.error_code == 0, result.message
    sent = [s for s in sent_in[1] if s.kind == Kind.DEPOSIT]
    assert {round(s.speed, 6) for s in sent} == {0.01}
    feed = 7.6 * 0.01  # of the file, within what the lead of the wire at corners takes and gives
    assert np.median([s.wire_feed_speed for s in sent]) == pytest.approx(feed, rel=0.02)


def test_what_does_not_go_with_a_program_is_refused(goal):
    for wrong, what in (
        ({'part': Path('')}, 'closed_loop needs a nominal part'),
        ({'passes': 2, 'mode': 'restore'}, 'strategy, allowance and passes belong to a part'),
        ({'program': None}, 'dialect and program_shift belong to a program'),
        ({'program_shift': (5.0, 0.0, 0.0)}, 'program_shift is'),
    ):
        with pytest.raises(JobError, match=what) as refused:
            check(replace(goal, **wrong))
        assert refused.value.code == Code.BAD_GOAL
    for text, what in (('G77', 'line 1: G77'), (pad().replace('F600', 'F6000'), 'travel speed')):
        goal.program.write_text(text)
        with pytest.raises(JobError, match=what) as refused:
            check(goal)
        assert refused.value.code == Code.BAD_PROGRAM


def test_a_program_beyond_the_machine_is_refused_before_anything_moves(goal):
    result = run(LabJob(replace(goal, program_shift=(0.3, 0.0, 0.0)), seed=3))
    assert result.failed and result.error_code == Code.PLAN_FAILED
    assert 'outside the machine' in result.message


def test_a_program_beside_the_plate_is_refused_before_the_arc(goal, sent_in):
    """The plate begins 20 mm before work zero; the program begins 36 mm before it."""
    moved = replace(goal, program_shift=(-0.076, 0.0, 0.0), loop_mode='monitor', part=Path(''))
    result = run(LabJob(moved, seed=3))
    assert result.error_code == Code.PLAN_FAILED and 'no plate under' in result.message
    assert '10.0 mm below work zero' in result.message
    assert set(sent_in) == {0}  # the scan
    assert run(LabJob(replace(moved, program_shift=(-0.056, 0.0, 0.0)), seed=3)).error_code == 0


def test_a_program_beyond_the_reach_of_the_gantry_is_refused_with_line_and_word(goal):
    """The reach is what the controller was told: 160 mm from machine zero, 40 mm from the plate's corner."""
    result = run(LabJob(goal, seed=3, overrides={'bridge': {'envelope_x': 0.16}}))
    assert result.error_code != 0 and result.layers == 0
    assert 'line 11: X64: ' in result.message
    assert ' its limit in the work frame is 40.0 mm' in result.message
