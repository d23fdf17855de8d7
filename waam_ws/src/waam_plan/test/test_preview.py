"""What an operator sees before the arc goes on: estimates by hand reckoning, pictures that show the plan."""

import re

import numpy as np
import pytest

from waam_plan.plan import Plan, PlannedLayer
from waam_plan.preview import picture as preview
from waam_plan.preview.page import write_page
from waam_plan.settings import PlanSettings
from waam_process.grid import GridSpec, HeightGrid
from waam_process.heat import effective_power, heat_input
from waam_process.segment import Kind, Segment

LENGTH, SPEED, LIT = 0.100, 0.010, 0.5  # of one bead: m, m/s, s that the arc burns before it


def layer_of(number: int, spec: GridSpec, z: float, width: float, height: float) -> PlannedLayer:
    """One bead along x: down, light, weld, up."""
    a, b, up = (0.0, 0.0, z), (LENGTH, 0.0, z), 0.010
    above_a, above_b = (0.0, 0.0, z + up), (LENGTH, 0.0, z + up)
    common = {'layer': number, 'bead': 1}
    segments = [
        Segment(0, Kind.IDLE, above_a, a, 0.05, layer=number),
        Segment(1, Kind.DWELL, a, a, SPEED, arc=True, dwell=LIT, **common),
        Segment(2, Kind.DEPOSIT, a, b, SPEED, arc=True, height=height, width=width, **common),
        Segment(3, Kind.IDLE, b, above_b, 0.05, layer=number),
    ]
    flat, every = np.full(spec.shape, z), np.ones(spec.shape, bool)
    return PlannedLayer(
        number, flat * 0 + height, flat, flat + height, segments, (1.0, 0.0, 0.0), every
    )


def plan_of(settings: PlanSettings, step: float = 2e-3, layers: int = 2) -> Plan:
    spec = GridSpec.covering(-0.01, -0.01, LENGTH + 0.01, 0.01, 1e-3)
    found = HeightGrid(spec, np.zeros(spec.shape))
    nominal = HeightGrid(spec, np.full(spec.shape, layers * step))
    every = np.ones(spec.shape, bool)
    made = [layer_of(k + 1, spec, k * step, 6e-3, 2e-3) for k in range(layers)]
    return Plan(spec, found, nominal, every, every, made, 0.02, settings)


def test_estimates_by_hand():
    """10 s of travel and 0.5 s of burning at the start, 15 l/min, 4 kW, of which 80 % reach the part."""
    for e in preview.estimates(plan_of(PlanSettings())):
        assert e.arc_time == pytest.approx(10.5)
        assert e.duration == pytest.approx(10.5 + 2 * 0.010 / 0.05)
        assert e.gas * 1e3 == pytest.approx(15 / 60 * 10.5)  # l
        assert e.heat == pytest.approx(42e3)  # J
        assert e.heat_input / 1e3 == pytest.approx(0.8 * 42e3 / 100)  # J/mm
        bead_mm3 = 0.73 * 6 * 2 * 100
        assert e.wire == pytest.approx(bead_mm3 / (np.pi * 0.6**2 * 0.92) * 1e-3)
        assert (e.length, e.beads, e.arc_starts) == (pytest.approx(0.1), 1, 1)


def test_heat_input_is_that_of_the_source():
    """Q_eff / V with Q_eff = I U eta_th (eq 2.18), for a power that is I U and no time before the travel."""
    current, voltage, eta = 180.0, 22.0, 0.75
    settings = PlanSettings(arc_power=current * voltage, arc_efficiency=eta)
    plan = plan_of(settings)
    for layer in plan.layers:
        layer.segments[1] = layer.segments[1].at(dwell=0.0)
    for e in preview.estimates(plan):
        assert e.heat_input == pytest.approx(effective_power(current, voltage, eta) / SPEED)
        assert e.heat_input == pytest.approx(eta * heat_input(current, voltage, SPEED))


@pytest.mark.parametrize(
    ('setting', 'field', 'others'),
    [
        ('gas_flow', 'gas', ('heat', 'heat_input', 'wire')),
        ('arc_power', 'heat', ('gas', 'wire')),
        ('arc_efficiency', 'heat_input', ('gas', 'heat', 'wire')),
    ],
)
def test_set_figures_change_what_they_are_for(setting, field, others):
    plain = PlanSettings()
    half = PlanSettings(**{setting: getattr(plain, setting) / 2})
    a, b = preview.estimates(plan_of(plain))[0], preview.estimates(plan_of(half))[0]
    assert getattr(b, field) == pytest.approx(getattr(a, field) / 2)
    assert all(getattr(a, name) == getattr(b, name) for name in others)


def test_page_says_the_estimates_and_what_they_are_made_of(tmp_path):
    write_page(plan_of(PlanSettings(arc_power=4600.0)), tmp_path / 'p.html')
    text = (tmp_path / 'p.html').read_text()
    rows = re.findall(r'<tr>((?:<td>[^<]*)+)', text)
    cells = [re.findall(r'<td>([^<]*)', row) for row in rows]
    head = re.findall(r'<th>([^<]*)', text.split('class="layers"')[1])
    for row in cells:
        shown = dict(zip(head, row, strict=True))
        assert shown['gas l'] == '2.6' and shown['energy kJ'] == '48'
        assert shown['heat input J/mm'] == f'{0.8 * 4600 * 10.5 / 100:.0f}'
    assert len(cells) == 2
    assert 'set power of 4600 W (arc_power), not from a model' in text and '15 l/min' in text
    assert '<td>5 l' in text  # both layers


def test_a_plan_without_layers_is_drawn(tmp_path):
    preview.draw(plan_of(PlanSettings(), layers=0), tmp_path / 'p.png')
    assert (tmp_path / 'p.png').read_bytes()[:4] == b'\x89PNG'
