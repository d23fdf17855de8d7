from dataclasses import replace

import numpy as np
import pytest

from waam_process.grid import GridSpec
from waam_scan.fusion.height_map import FusedMap
from waam_scan.fusion.plausibility import (
    PlausibilityLimits,
    jump_reasons,
    map_reasons,
    stream_reasons,
)

SPEC = GridSpec(0.0, 0.0, 1e-3, 20, 20)
LIMITS = PlausibilityLimits()


def flat(height=0.0, known=1.0, residual=30e-6) -> FusedMap:
    z = np.full(SPEC.shape, height, np.float32)
    z.ravel()[round(known * z.size) :] = np.nan
    coverage = float(np.isfinite(z).mean())
    return FusedMap(
        spec=SPEC, z=z, sigma=z * 0, count=z * 0, scatter=z * 0, share=z * 0, coverage=coverage, residual=residual,
        points_used=1000, dropouts=0, outside=0, spikes=0,
    )  # fmt: skip


def test_a_good_map_gives_no_reason():
    assert map_reasons(flat(), LIMITS) == []
    assert jump_reasons(flat(2e-3), np.zeros(SPEC.shape), 1, LIMITS) == []
    assert stream_reasons(1000, 3, 100, 0, 0.02, LIMITS) == []


@pytest.mark.parametrize(
    'fused, word', [(flat(known=0.3), 'coverage'), (flat(residual=0.5e-3), 'scatter')]
)
def test_thin_and_noisy_maps_are_doubted(fused, word):
    (reason,) = map_reasons(fused, LIMITS)
    assert word in reason


@pytest.mark.parametrize(
    'height, layers, word', [(9e-3, 1, 'grew'), (-2e-3, 1, 'sank'), (3e-3, 0, 'grew')]
)
def test_jumps_that_no_layer_can_make_are_doubted(height, layers, word):
    (reason,) = jump_reasons(flat(height), np.zeros(SPEC.shape), layers, LIMITS)
    assert word in reason and '100.0%' in reason


def test_several_layers_may_grow_more_and_a_few_cells_may_do_anything():
    assert jump_reasons(flat(9e-3), np.zeros(SPEC.shape), 2, LIMITS) == []
    m = flat()
    z = m.z.copy()
    z[0, :19] = 50e-3  # 4.75 % of the cells
    assert jump_reasons(replace(m, z=z), np.zeros(SPEC.shape), 1, LIMITS) == []


def test_lost_coverage_and_maps_without_common_cells_are_doubted():
    (reason,) = jump_reasons(flat(known=0.55), np.zeros(SPEC.shape), 1, LIMITS)
    assert 'coverage fell by 45.0%' in reason
    # what is missing of such a map is for the job to look at again
    assert jump_reasons(flat(known=0.8), np.zeros(SPEC.shape), 1, LIMITS) == []
    (reason,) = jump_reasons(flat(), np.full(SPEC.shape, np.nan), 1, LIMITS)
    assert 'no cell' in reason


@pytest.mark.parametrize(
    'args, word',
    [
        ((700, 300, 100, 0, 0.0), '300 of 1000 profiles'),
        ((1000, 0, 70, 30, 0.0), '30 of 100 batches'),
        ((1000, 0, 100, 0, 2.0), '2.00 s older'),
    ],
)
def test_bad_streams_are_doubted(args, word):
    (reason,) = stream_reasons(*args, LIMITS)
    assert word in reason
