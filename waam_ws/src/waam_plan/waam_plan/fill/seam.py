"""Where a layer begins its closed lines."""

from __future__ import annotations

# golden section, of a ring's length: its seam moves by this from layer to layer and spreads evenly
GOLDEN = 0.381966


def seam_shift(number: int) -> float:
    """Share of a ring's length at which layer `number` begins it."""
    return GOLDEN * (number - 1) % 1.0
