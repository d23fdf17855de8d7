"""A temperature that does not answer to the layers is not believed; the pyrometer is aimed at the metal."""

from __future__ import annotations

import math

import numpy as np
import pytest
from builtin_interfaces.msg import Time

from waam_job.conversions import aim_to_msg
from waam_job.model.geometry import aim_point
from waam_job.model.goal import Code
from waam_job.model.records import State
from waam_job.model.snapshots import HEAT_SILENT, Heat
from waam_process.segment import Kind, Segment

DOUBT = 'layer 1 raised it by 0.1 K, 40 K were expected'
REAL = {'simulated': False, 'calibration_max_days': 0.0}


def doubted_after_layer_1(make_cell):
    """A cell whose compensator doubts the temperature as soon as metal was laid."""
    cell = make_cell()
    inner = cell._lay

    def lay(s):
        inner(s)
        if s.kind == Kind.DEPOSIT:
            cell.doubt = DOUBT

    cell._lay = lay
    return cell


def doubts(cell) -> list:
    return [a for a in cell.anomalies if a.class_name == 'temperature']


def test_a_doubted_temperature_is_a_warning_before_layer_2(make_cell, make_runner):
    cell = doubted_after_layer_1(make_cell)
    status = make_runner(cell)[0].run()
    assert status.state == State.DONE and status.layers >= 2
    found = doubts(cell)
    assert len(found) == 1
    assert (found[0].severity, found[0].layer) == ('WARNING', 2)
    assert DOUBT in found[0].text and 'not believed' in found[0].text


def test_a_real_cell_lays_no_second_layer_by_a_doubted_temperature(make_cell, make_runner):
    cell = doubted_after_layer_1(make_cell)
    status = make_runner(cell, settings=REAL)[0].run()
    assert status.state == State.FAILED and status.error_code == Code.MACHINE_NOT_READY
    assert DOUBT in status.message and 'allow_unbelieved_temperature' in status.message
    assert {s.layer for s in cell.executed if s.kind == Kind.DEPOSIT} == {1}
    assert [a.severity for a in doubts(cell)] == ['FAULT']


def test_a_real_cell_goes_on_when_told(make_cell, make_runner):
    cell = doubted_after_layer_1(make_cell)
    told = {**REAL, 'allow_unbelieved_temperature': True}
    assert make_runner(cell, settings=told)[0].run().state == State.DONE
    assert [a.severity for a in doubts(cell)] == ['WARNING']


def test_a_doubt_before_anything_was_laid_does_not_count(make_cell, make_runner):
    cell = make_cell()
    cell.doubt = DOUBT
    assert make_runner(cell, settings=REAL, layers=1)[0].run().state == State.DONE
    assert not doubts(cell)


def bead(start, end, kind=Kind.DEPOSIT) -> Segment:
    return Segment(index=1, kind=kind, start=start, end=end, width=6e-3, speed=0.01)


def test_the_pyrometer_is_aimed_at_the_middle_of_the_metal():
    pad = [bead((0.0, y, 2e-3), (0.04, y, 2e-3)) for y in np.arange(0.0, 0.021, 4e-3)]
    idle = bead((0.0, 0.0, 0.1), (0.3, 0.3, 0.1), Kind.IDLE)
    assert aim_point([idle, *pad]) == pytest.approx((0.02, 0.01, 2e-3))
    assert aim_point([idle]) is None


def test_the_pyrometer_is_aimed_at_a_ring_and_not_through_it():
    angles = np.linspace(0, 2 * np.pi, 37)
    ring = [(0.05 + 0.03 * np.cos(a), 0.05 + 0.03 * np.sin(a), 0.0) for a in angles]
    beads = [bead(a, b) for a, b in zip(ring[:-1], ring[1:], strict=True)]
    x, y, _ = aim_point(beads)
    assert np.hypot(x - 0.05, y - 0.05) == pytest.approx(0.03, abs=5e-4)


def test_the_aim_is_given_in_machine_coordinates():
    msg = aim_to_msg((0.01, 0.02, 0.003), (0.1, 0.08, 0.02), Time(sec=3))
    assert msg.header.frame_id == 'machine' and msg.header.stamp.sec == 3
    assert (msg.point.x, msg.point.y, msg.point.z) == pytest.approx((0.11, 0.1, 0.023))


def test_what_a_silent_node_said_last_is_neither_believed_nor_the_cause():
    said = Heat(known=True, temperature=80.0, ready=True, plausible=True)
    assert said.heard(HEAT_SILENT) == said
    old = said.heard(HEAT_SILENT + 2.0)
    assert not old.plausible and not old.ready and 'thermal_compensator' in old.reasons[0]
    doubted = Heat(known=True, reasons=('pyrometer stepped by -50 K',)).heard(HEAT_SILENT + 2.0)
    assert doubted.reasons == old.reasons
    assert Heat().heard(math.inf) == Heat()
