"""The way round a layer is laid, for the scanner beside the torch."""

from __future__ import annotations

import numpy as np
import pytest

from waam_plan.lay.trailing import seen_finished, trailing
from waam_plan.settings import PlanSettings

SETTINGS = PlanSettings(bead_width=6e-3)
NONE = np.empty((0, 2))


def rail(beads: int, length: float = 0.16) -> list[list[np.ndarray]]:
    """One chain of beads along x, 3.6 mm apart, from the first to the last, the first one along +x."""
    lines = [np.array([[0.0, 3.6e-3 * k], [length, 3.6e-3 * k]]) for k in range(beads)]
    return [[line if k % 2 == 0 else line[::-1] for k, line in enumerate(lines)]]


@pytest.mark.parametrize('beads', [2, 5, 7, 8])
def test_the_last_bead_runs_away_from_the_scanner_whatever_the_number_of_beads(beads):
    chains = rail(beads)
    found = trailing(chains, NONE, SETTINGS)
    last = found[-1][-1]
    assert last[-1, 0] < last[0, 0]
    # all that lies farther than the scanner from the end where the layer ends, and nothing else
    assert seen_finished(found, SETTINGS) == pytest.approx(100 / 160, abs=0.02)
    laid = {tuple(np.sort(line[:, 0]).round(6)) + (line[0, 1],) for line in found[0]}
    assert laid == {tuple(np.sort(line[:, 0]).round(6)) + (line[0, 1],) for line in chains[0]}


def test_what_cannot_be_seen_better_stays():
    short = rail(3, 0.05)
    assert seen_finished(short, SETTINGS) == 0.0 and trailing(short, NONE, SETTINGS) is short
    ring = [[np.array([[0, 0], [0.16, 0], [0.16, 0.01], [0, 0.01], [0, 0]], float)]]
    assert trailing(ring, NONE, SETTINGS) is ring


@pytest.mark.parametrize('beads', [4, 5])
def test_neighbouring_layers_begin_on_opposite_sides(beads):
    chains = rail(beads)
    side = 3.6e-3 * (beads - 1)
    for y, same in ((0.0, False), (side, True)):
        found = trailing(chains, np.array([[0.1, y]]), SETTINGS)
        assert (found is chains) == same
        assert abs(found[0][0][0, 1] - y) == pytest.approx(side)
