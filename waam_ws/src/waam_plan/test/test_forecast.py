"""What a plan is said to leave: the process model that shared out its metal, asked again."""

from dataclasses import replace

import numpy as np
import pytest

from waam_plan.layers.forecast import growth, pieces_of
from waam_plan.layers.restore import plan_restoration
from waam_plan.settings import PlanSettings

S = PlanSettings()


def test_growth_holds_the_metal_of_the_segments_and_lies_where_it_was_planned(worn_block):
    plan = plan_restoration(*worn_block(4e-3), S)
    for layer in plan.layers:
        laid = growth(layer, plan.spec, S)
        assert laid.sum() * plan.spec.resolution**2 == pytest.approx(layer.volume, rel=1e-6)
        error = (laid - layer.planned)[plan.interior]
        assert abs(error.mean()) < 0.05e-3 and np.sqrt(np.mean(error**2)) < 0.25e-3


def test_chains_reach_from_arc_on_to_arc_off(worn_block):
    plan = plan_restoration(*worn_block(2e-3), S)
    pieces = pieces_of(plan.layers[0])
    assert len(set(pieces.chain)) == plan.layers[0].arc_starts
    assert pieces.length.sum() == pytest.approx(plan.layers[0].length)


def test_a_layer_without_segments_adds_nothing(worn_block):
    plan = plan_restoration(*worn_block(2e-3), S)
    assert not growth(replace(plan.layers[0], segments=[]), plan.spec, S).any()
