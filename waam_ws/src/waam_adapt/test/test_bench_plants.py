"""The plants of the adaptation benchmarks: do they follow the recording, and is the oracle a floor?"""

import sys
from pathlib import Path

import numpy as np
import pytest

BENCH = Path(__file__).parents[4] / 'bench'
sys.path.insert(0, str(BENCH))

from lib import adapt_loop, adapt_plants, adapt_wall  # noqa: E402


@pytest.mark.skipif(
    not adapt_wall.RECORDING.exists(), reason='recordings are not beside the checkout'
)
def test_wall_drifts_in_open_loop_as_the_recording_does():
    recorded, plant = adapt_wall.load('OL_hot')['error'], adapt_wall.replay_open_loop(0)
    assert np.sqrt(np.mean(plant**2)) == pytest.approx(np.sqrt(np.nanmean(recorded**2)), rel=0.2)
    assert plant[-1].mean() == pytest.approx(np.nanmean(recorded[-1]), rel=0.25)
    assert adapt_wall.fit('OL_hot')['a'] == pytest.approx(adapt_wall.WallPhysics().a, abs=0.02)


def late(runs, column=0):
    """Mean over runs of the figure of layers 21 and later."""
    return np.mean([np.array(r.figures)[20:, column] for r in runs])


def test_on_walls_the_chain_comes_close_to_the_oracle_and_needs_identification():
    full = adapt_loop.Settings('damped_inverse')
    blind = adapt_loop.Settings('damped_inverse', identify=False)
    runs = [adapt_loop.run(adapt_wall.Wall(s), full, 60) for s in (0, 1)]
    floor = late([adapt_loop.wall_oracle(adapt_wall.Wall(s), 60) for s in (0, 1)])
    without = late([adapt_loop.run(adapt_wall.Wall(0), blind, 60)])
    assert floor * 0.9 < late(runs) < 1.25 * floor
    assert without > 2 * late(runs)
    exponent = np.mean([r.exponent[-1] for r in runs])
    assert exponent == pytest.approx(adapt_wall.WallPhysics().a, abs=0.1)


def test_on_pads_the_oracle_is_a_floor_and_open_loop_is_far_above():
    figures = [
        run.figures[-1][1]
        for run in (
            adapt_loop.pad_oracle(adapt_plants.Pad(0), 5, rounds=2),
            adapt_loop.run(adapt_plants.Pad(0), adapt_loop.Settings('damped_inverse'), 5),
            adapt_loop.open_loop(adapt_plants.Pad(0), 5),
        )
    ]
    assert figures[0] < 0.8 * figures[1] < 0.4 * figures[2]


def test_same_seed_same_metal():
    a, b = (adapt_loop.run(adapt_wall.Wall(3), adapt_loop.Settings(), 6).figures for _ in range(2))
    assert a == b


def test_on_pads_the_network_with_the_bead_model_beats_the_best_explicit_law():
    """Neither the pad's physics nor its lag, humps and craters are in the model; it is told the paths."""
    plain, ours = (
        adapt_loop.run(adapt_plants.Pad(0), adapt_loop.Settings(law, 1.1), 20)
        for law in ('damped_inverse', 'unet')
    )
    assert ours.fallbacks == 0
    assert ours.figures[-1][1] < 0.8 * plain.figures[-1][1]
    assert ours.figures[-1][2] < 0.5e-3 < plain.figures[-1][2]
