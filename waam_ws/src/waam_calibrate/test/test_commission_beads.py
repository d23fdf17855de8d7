"""First arcs of a commissioning: windows of the arc, beads by maps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from waam_calibrate import commission_beads as core
from waam_calibrate.evidence import EvidenceError
from waam_process.grid import GridSpec
from waam_process.materials import get

MATERIAL = get('er70s-6')
FEED, SPEED, VOLTS = MATERIAL.wire_feed, MATERIAL.speed, MATERIAL.voltage
SPEC = GridSpec.covering(-0.01, -0.015, 0.07, 0.015, 0.0005)


def record(**changes) -> core.ArcRecord:
    """5 s of an arc after half a second that it takes to strike."""
    time = np.arange(0.0, 6.0, 0.01)
    enabled, lit = time > 0.3, time > 0.45
    burns = {
        'current': 120.0 * lit, 'voltage': np.where(lit, VOLTS, 65.0), 'wire': FEED * enabled,
        'wire_commanded': FEED * enabled,
    }  # fmt: skip
    return core.ArcRecord(**{'time': time, 'enabled': enabled, 'lit': lit, **burns, **changes})


def judged(found: core.ArcRecord):
    return core.arc(found, FEED, VOLTS, MATERIAL)


def test_an_arc_within_its_windows():
    found = judged(record())
    assert found.passed and found.text.startswith('120 A, 22.0 V of 22')
    assert found.checks[0].value == pytest.approx(0.15, abs=0.011)


@pytest.mark.parametrize(
    ('name', 'value', 'said'),
    [
        ('current', np.full(600, 20.0), 'current 20'),
        ('current', np.full(600, -120.0), 'current -120'),
        ('voltage', np.full(600, 30.0), 'voltage read less asked 8'),
        ('wire', np.full(600, 0.5 * FEED), 'wire read over asked 0.5'),
    ],
)
def test_what_lies_beside_its_window_is_named(name, value, said):
    found = judged(record(**{name: value}))
    assert not found.passed and found.text.startswith(said) and found.mend


def test_an_arc_that_goes_out_in_between_is_none_that_stays():
    good = record()
    lit = good.lit & ~((good.time > 3.0) & (good.time < 3.3))
    assert judged(replace(good, lit=lit)).text.startswith('arc stays 9')
    with pytest.raises(EvidenceError, match='no arc'):
        judged(replace(good, lit=np.zeros(600, bool)))
    with pytest.raises(EvidenceError, match='steadily'):
        judged(replace(good, lit=good.time > 5.8))


def bead(efficiency: float, width: float = 0.006) -> tuple[np.ndarray, np.ndarray]:
    """Maps before and after a parabola along x at y = 0."""
    area = efficiency * MATERIAL.wire_area * FEED / SPEED
    height = 1.5 * area / width
    profile = height * np.clip(1 - (2 * SPEC.y / width) ** 2, 0, None)
    before = np.full(SPEC.shape, 0.010)
    return before, before + profile[:, None]


PIECE = core.Bead('first', (0.01, 0.05), 0.0, FEED, SPEED, VOLTS)


def test_a_bead_gives_its_efficiency_width_and_height():
    seen = core.section(PIECE, SPEC, *bead(0.9))
    assert seen.area == pytest.approx(0.9 * MATERIAL.wire_area * FEED / SPEED, rel=0.03)
    assert seen.width == pytest.approx(0.0057, abs=6e-4)
    assert core.mean_of([seen, seen]) == seen
    found = core.beads([(PIECE, seen)], MATERIAL)
    assert found.passed and found.checks[0].value == pytest.approx(0.9, abs=0.03)


def test_too_little_metal_and_what_the_maps_do_not_show():
    thin = core.section(PIECE, SPEC, *bead(0.5))
    found = core.beads([(PIECE, thin)], MATERIAL)
    assert not found.passed and found.text.startswith('first: efficiency 0.5')
    before, after = bead(0.9)
    with pytest.raises(EvidenceError, match='nothing grew'):
        core.section(PIECE, SPEC, before, before)
    after[:, : SPEC.cols // 2] = np.nan
    with pytest.raises(EvidenceError, match='do not show'):
        core.section(PIECE, SPEC, before, after)
