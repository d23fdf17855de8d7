"""The bead width in whole jobs of the laboratory: measured by the scans, held by the voltage."""

import pytest

from waam_lab import parts, run

PLANNED = 7e-3  # m
WIDE = {'metal_width_ref': 7.5e-3}  # a cell whose beads are wider than its data sheet says


@pytest.fixture(scope='module')
def jobs(tmp_path_factory):
    """Two layers of a block without and with the width held."""
    folder = tmp_path_factory.mktemp('width')

    def lay(held: bool):
        overrides = {'cell': WIDE, 'correction_server': {'hold_width': held, 'law': 'bead_solver'}}
        made = {'layers': 2, 'bead_width': PLANNED, 'overrides': overrides, 'preset': 'gentle'}
        return run(parts.job(folder, 'block', 101, **made))

    return lay(False), lay(True)


def test_the_scan_after_a_layer_measures_its_width(jobs):
    for r in jobs:
        assert not r.failed, r.message
        row = r.reports[1]
        true = r.bead_widths[1]
        # `true` is the width of the pool; at the planned feed the metal lies 0.44 mm further out than that
        assert row['bead_width'] - 0.44e-3 == pytest.approx(true, abs=0.2e-3)
        assert 0 < row['bead_width_u'] < 0.3e-3
        assert row['bead_width'] > 1.05 * row['bead_width_expected']
        assert r.reports[0]['bead_width'] is None  # before the first layer


def test_the_voltage_brings_it_to_what_was_planned(jobs):
    free, held = jobs
    assert free.bead_widths[1] == held.bead_widths[1]
    assert free.bead_widths[2] - PLANNED > 0.3e-3
    assert abs(held.bead_widths[2] - PLANNED) < 0.5 * abs(free.bead_widths[2] - PLANNED)
    assert held.reports[1]['width_ratio'] > 1.05 and free.reports[1]['width_ratio'] == 0
    assert held.reports[1]['voltage_mean'] < free.reports[1]['voltage_mean'] - 1.0


def test_the_height_is_left_to_speed_and_wire(jobs):
    free, held = jobs
    assert held.rms == pytest.approx(free.rms, rel=0.25)
    assert held.wire == pytest.approx(free.wire, rel=0.03)
