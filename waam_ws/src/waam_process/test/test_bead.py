import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from waam_process import bead, materials
from waam_process.units import m_min

STEEL = materials.get('er70s-6')
widths, heights = st.floats(2e-3, 15e-3), st.floats(0.3e-3, 4e-3)
speeds, feeds = st.floats(1e-3, 0.05), st.floats(0.01, 0.3)


@given(widths, heights, speeds)
def test_wire_feed_inverts_the_bead_area(width, height, speed):
    feed = bead.wire_feed(width, height, speed, STEEL)
    assert bead.bead_area(feed, speed, STEEL) == pytest.approx(bead.bead_section(width, height))


@given(feeds, speeds)
def test_mass_of_wire_times_efficiency_is_mass_of_bead(feed, speed):
    time = 7.0
    wire = math.pi / 4 * 0.0012**2 * feed * time * STEEL.density
    length = speed * time
    metal = bead.bead_area(feed, speed, STEEL) * length * STEEL.density
    assert metal == pytest.approx(0.92 * wire)
    assert bead.deposition_rate(feed, STEEL, STEEL.density) * time == pytest.approx(metal)


@given(feeds, speeds, widths)
def test_layer_of_overlapped_beads_goes_with_the_inverse_of_speed(feed, speed, width):
    pitch = bead.AREA_FACTOR * width
    one, two = (bead.layer_height(feed, v, pitch, STEEL) for v in (speed, 2 * speed))
    assert one == pytest.approx(2 * two)
    assert bead.wire_feed(width, one, speed, STEEL) == pytest.approx(feed)


def test_default_regime_needs_about_five_metres_a_minute():
    assert STEEL.wire_feed == pytest.approx(m_min(5.05), rel=5e-3)


@given(heights, speeds, st.floats(0.7, 1.3), st.floats(0.7, 1.3))
def test_commanded_growth_is_what_the_mass_balance_says(height, speed, faster, more):
    base = bead.wire_feed(6e-3, height, speed, STEEL)
    growth = bead.commanded_growth(height, base * more, base, speed * faster, speed)
    pitch = bead.AREA_FACTOR * 6e-3
    assert growth == pytest.approx(bead.layer_height(base * more, speed * faster, pitch, STEEL))


@pytest.mark.parametrize('speed', [0.0, -1.0, math.nan])
def test_speed_that_no_torch_has(speed):
    with pytest.raises(bead.BeadError, match='speed must be above zero'):
        bead.bead_area(0.08, speed, STEEL)
