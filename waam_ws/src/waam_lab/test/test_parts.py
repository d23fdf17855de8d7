"""The parts that the laboratory makes, and what it says of their edges."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from waam_lab import LabResult, parts, run
from waam_plan.slice.section import section_polygons


@pytest.mark.parametrize('name', [*parts.PARTS, *parts.BUILDS])
def test_meshes_are_closed_and_wear_takes_metal_away(name):
    nominal, worn = {**parts.PARTS, **parts.BUILDS}[name]().meshes()
    assert nominal.is_watertight and nominal.is_winding_consistent and nominal.volume > 0
    assert np.allclose(nominal.bounds[0], 0, atol=1e-9)
    if worn is not None:
        assert worn.is_watertight and 0.5 < worn.volume / nominal.volume < 0.98
        # the laboratory and the job put the lower corner of both into the work zero
        assert np.allclose(worn.bounds[:, :2], nominal.bounds[:, :2], atol=1e-6)
        assert worn.bounds[0, 2] == nominal.bounds[0, 2]


@pytest.mark.parametrize(
    'name,area',
    [('l', 28 * 80 + 28 * 60 - 28**2), ('ring', np.pi * (40**2 - 22**2)), ('block', 2400)],
)
def test_outlines_are_exact(name, area):
    mesh = {**parts.PARTS, **parts.BUILDS}[name]().meshes()[0]
    found = section_polygons(np.asarray(mesh.vertices), np.asarray(mesh.faces), 3.3)
    assert shapely.unary_union(found).area == pytest.approx(area, rel=2e-3)


def test_an_unknown_part_is_refused(tmp_path):
    with pytest.raises(KeyError, match='sphere'):
        parts.write(tmp_path, 'sphere')


@pytest.fixture(scope='module')
def wall(tmp_path_factory) -> LabResult:
    """A blade tip of one layer."""
    return run(parts.job(tmp_path_factory.mktemp('parts'), 'blade', seed=101, layers=1))


def test_a_wall_of_one_bead_is_judged_along_its_crown(wall):
    assert not wall.failed, wall.message
    m = wall.maps
    assert m.interior.any() and np.isfinite(wall.rms)
    wide = m.region.sum(axis=0).max() * m.spec.resolution
    crown = m.interior.sum(axis=0)[m.interior.any(axis=0)] * m.spec.resolution
    assert np.median(crown) < 0.6 * wide
    assert wall.verdict in ('in tolerance', 'out of tolerance')


def test_overrun_and_the_rim_are_told(wall):
    assert wall.verdict_edges == 'out of tolerance'  # a bead is round
    assert 0 < wall.share_edges < 1 and wall.rms_edges > 0
    assert 0 < wall.overrun_mean <= wall.overrun < 5e-3
