"""Idle moves, dwells and leads: over the metal, without a jump in acceleration."""

import math

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from waam_plan.harmonic import HarmonicLaw
from waam_plan.layers.build import plan_build
from waam_plan.layers.restore import plan_restoration
from waam_plan.mesh.part import load_part
from waam_plan.plan import base_feed, hop
from waam_plan.settings import PlanSettings
from waam_process.segment import Kind, check_chain


@given(st.floats(1e-3, 0.5), st.floats(5e-3, 0.2), st.floats(0.05, 5.0))
def test_harmonic_law_joins_without_a_break_in_the_second_derivative(length, speed, acceleration):
    law = HarmonicLaw.within(length, speed, acceleration)
    t = np.linspace(0, law.duration, 2001)
    assert law.position(0) == pytest.approx(0, abs=1e-12)
    assert law.position(law.duration) == pytest.approx(length)
    for end in (0.0, law.duration):
        assert abs(law.speed(end)) < 1e-9 * speed + 1e-12
        assert abs(law.acceleration(end)) < 1e-9 * acceleration + 1e-12
    assert law.speed(t).max() <= speed * (1 + 1e-9)
    assert np.abs(law.acceleration(t)).max() <= acceleration * (1 + 1e-9)
    dt = t[1]
    np.testing.assert_allclose(
        np.gradient(law.speed(t), dt)[1:-1], law.acceleration(t)[1:-1], atol=0.01 * acceleration
    )


def test_idle_moves_follow_the_law_or_one_speed():
    start, end = (0.0, 0.0, 0.0), (0.05, 0.0, 0.0)
    s = PlanSettings()
    moves = hop(start, end, 0.02, s)
    check_chain([m.at(index=i) for i, m in enumerate(moves)])
    assert moves[0].start == start and moves[-1].end == end
    level = [m for m in moves if m.start[2] == m.end[2]]
    speeds = np.array([m.speed for m in level])
    assert speeds[0] < 0.25 * speeds.max() and speeds.max() <= s.idle_speed
    law = HarmonicLaw.within(0.05, s.idle_speed, s.idle_acceleration)
    assert sum(m.duration for m in level) == pytest.approx(law.duration)
    assert len(hop(start, end, 0.02, PlanSettings(idle_law='plain'))) == 3


def pits(x, y):
    """Two pits with a wall of full height between them."""
    return np.where(np.abs(x - 0.03) < 0.008, 0.0, 0.006)


def test_idle_moves_pass_over_the_metal_as_built(worn_block):
    """Between two pits the torch clears the wall; inside the first layer it stays lower than the top of the part."""
    found, nominal = worn_block(pits)
    plan = plan_restoration(found, nominal, PlanSettings(clearance=4e-3))
    for layer in plan.layers:
        metal = np.where(layer.footprint, layer.target_after, found.z)
        for s in layer.segments:
            if s.arc or math.dist(s.start[:2], s.end[:2]) < 1e-9:
                continue
            for share in np.linspace(0, 1, 20):
                x, y, z = (a + share * (b - a) for a, b in zip(s.start, s.end, strict=True))
                row, col = plan.spec.cell(x, y)
                around = metal[row - 3 : row + 4, col - 3 : col + 4]
                assert z >= np.nanmax(around) + 3.9e-3
    lowest = [s for s in plan.layers[0].segments if s.kind == Kind.IDLE]
    assert max(s.start[2] for s in lowest) <= plan.safe_z + 1e-12


def test_low_metal_is_passed_low(tmp_path):
    """In the first layer of a tall tube the torch does not climb to where the last layer will be."""
    path = tmp_path / 'tube.stl'
    trimesh.creation.annulus(r_min=10, r_max=30, height=40).export(path)
    s = PlanSettings(strategy='zigzag')  # rings need no idle move
    plan = plan_build(load_part(path), s)
    layer = plan.layers[0]
    lit = [i for i, x in enumerate(layer.segments) if x.arc]
    between = [x.end[2] for x in layer.segments[lit[0] : lit[-1]] if not x.arc]
    assert max(between) == pytest.approx(2e-3 + s.clearance) and plan.safe_z > 0.045


def test_short_beads_wait_and_the_arc_is_lit_before_and_put_out_before_the_end(worn_block):
    found, nominal = worn_block(0.002, size=(0.03, 0.012))
    plain = plan_restoration(found, nominal, PlanSettings())
    s = PlanSettings(bead_time=60.0, lead_on=0.4, lead_off=3e-3)
    plan = plan_restoration(found, nominal, s)
    layer = plan.layers[0]
    check_chain(layer.segments)
    (lit,) = [x for x in layer.segments if x.kind == Kind.DWELL and x.arc]
    (wait,) = [x for x in layer.segments if x.kind == Kind.DWELL and not x.arc]
    assert lit.dwell == 0.4 and layer.segments[layer.segments.index(lit) + 1].arc
    assert lit.wire_feed_speed == base_feed(layer.deposits[0], s) and lit.voltage == s.voltage
    assert wait.dwell == pytest.approx(60 - plain.arc_time, abs=1e-6)
    assert wait.start[2] > layer.deposits[-1].end[2] + 0.9 * s.clearance
    assert plain.length - plan.length == pytest.approx(3e-3, abs=1e-6)
    assert plan.arc_starts == plain.arc_starts
