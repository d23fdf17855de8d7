"""A thick layer stays low where it is foretold to grow too much, if a thinner one comes on top."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from test_beads import SIZE, H, pad, refined
from test_residual import leaving, network, rough

from waam_adapt.beads import headroom
from waam_adapt.grids import CELLS_PER_BEAD, Resampler
from waam_adapt.identify.evidence import Layer
from waam_adapt.identify.identification import Identifier
from waam_adapt.laws.registry import make_law
from waam_adapt.types import CorrectionError, Predicted

INNER = np.zeros(SIZE)
INNER[6:-6, 6:-6] = 1.0


def foretold(height: float) -> np.ndarray:
    """A hump and a hollow of so much, in shares of the layer."""
    growth = np.zeros(SIZE)
    growth[12:16, 10:14], growth[12:16, 26:30] = height, -height
    return growth


def room(next_thickness: float, height: float = 0.2) -> np.ndarray | float:
    request = pad(0.5e-3, next_thickness=next_thickness)
    return headroom.under_thinner(request, foretold(height), INNER)


@pytest.mark.parametrize('after', [0.0, H, 0.8 * H, 2 * H])
def test_without_a_thinner_layer_on_it_a_layer_leaves_no_room(after):
    assert np.all(room(after) == 0.0)


@given(st.floats(0.02, 0.4))
def test_room_is_left_for_humps_alone_and_the_level_stays(height):
    found = room(0.5 * H, height)
    assert float((found * INNER).sum()) == pytest.approx(0.0, abs=1e-9)
    even = found[20, 20]
    assert found[14, 12] - even == pytest.approx(headroom.SHARE * height)
    assert found[14, 28] == pytest.approx(even)  # a hollow is filled by the layer itself
    assert not found[:6].any()


def test_less_metal_is_asked_for_where_room_is_left():
    def mean(share: float) -> float:
        told = Predicted(np.zeros(SIZE), np.ones(SIZE), 'x', headroom=share * foretold(1.0).clip(0))
        x = refined(replace(pad(0.5e-3), predicted=told))
        return float(x[36:48, 30:42].mean())

    assert mean(0.0) == pytest.approx(1.0, abs=0.01)
    assert mean(0.2) < 0.92


def test_the_law_leaves_room_only_under_a_thinner_layer(tmp_path):
    law = make_law('unet', model=str(network(tmp_path / 'n.npz', leaving(0.5))))
    thick = rough()
    thin = law.predict(replace(thick, next_thickness=0.4 * float(thick.planned.max())))
    assert np.abs(thin.headroom).max() > 0
    assert np.all(law.predict(thick).headroom == 0)
    assert (thin.weighed(0.5).headroom == 0.5 * thin.headroom).all()
    other = law.predict(replace(thick, next_thickness=thin.growth.max() * 1e-3, ratio_high=1.8))
    assert np.all(other.headroom == 0)


@pytest.mark.parametrize('lowered', [False, True])
def test_what_was_left_low_on_purpose_is_not_taken_for_what_the_loop_leaves(lowered):
    """The layer ends as it was told to, room included: what was told of it earns its weight either way."""
    left = 0.1 * np.sin(np.arange(SIZE[1]) / 2) * np.ones(SIZE) * INNER
    room = 3 * left.clip(0) if lowered else 0.0
    told = Predicted(np.zeros(SIZE), np.ones(SIZE), 'x', left=left, headroom=room)
    who = Identifier(watch_beads=True)
    who.start('job', 1)
    request = who.prepare(pad(0.5e-3, predicted=told))
    weights = request.predicted
    stays = left - weights.left - weights.headroom
    cell = request.bead_width / CELLS_PER_BEAD
    grid = Resampler.of(request.z.shape, request.resolution, cell)
    after = np.where(request.footprint, H * (1 + grid.fine(stays)), 0.0)
    who.start('job', 2)
    who.add(Layer(request.z, after, request.planned, request.resolution, request.bead_width))
    assert who.left_skill.layers == 1
    assert who.left_skill.weight > Identifier().left_skill.weight


@pytest.mark.parametrize('value', [-1e-3, 0.06, np.inf])
def test_a_thickness_that_cannot_be_is_refused(value):
    with pytest.raises(CorrectionError, match='next_thickness'):
        pad(0.5e-3, next_thickness=value)
