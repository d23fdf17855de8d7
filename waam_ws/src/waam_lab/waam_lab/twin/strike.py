"""Whether the arcs of a cell strike: the controller takes an arc as struck from a certain current on, and a strike is
fed with less wire than the bead, so a cell whose current falls steeply with the wire may miss it at thin beads."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from waam_sim.arc import Arc, ArcParams, advance_arc, advance_wire
from waam_sim.compiled import jit, random_state

from .electric import Steady, current

# of the controller (waam_firmware/core/machine/waam_config.c); a test holds that they are the same
WIRE_FACTOR, ESTABLISHED, HOLDS, WAITS, TRIES = 0.5, 30.0, 20, 1000, 3  # -, A, ms, ms, -
ROWS = 10  # of telemetry at the beginning of an arc, whose wire feed counts as that of the strike
SURE = 0.99
STRIKES = 400  # simulated for one wire feed
FEEDS = np.geomspace(0.01, 0.3, 128)  # m/s, where the least that is sure is looked for
VOLTAGE, STEP = 20.0, 1e-3  # V, s


@dataclass(frozen=True)
class Strikes:
    """feed: wire feed at the thinnest start of an arc in the records, m/s; current: mean of the found cell while it
    strikes there, A; chance: share of arcs that burn there after the controller's last try; sure: least wire feed, m/s,
    at which SURE of them do, NaN when there is none up to 0.3 m/s."""

    feed: float
    current: float
    chance: float
    sure: float

    @property
    def words(self) -> str:
        """For people: wire feeds in m/min."""
        text = (
            f'thinnest start of an arc in these records: wire {self.feed * 60:.2f} m/min; there the found cell strikes '
            f'at {self.current:.0f} A (the controller asks for {ESTABLISHED:.0f} A), {self.chance:.1%} of its arcs '
            f'burn after the last try'
        )
        if not math.isfinite(self.sure):
            return f'{text}; no wire feed makes it sure'
        return f'{text}; {SURE:.0%} do from {self.sure * 60:.2f} m/min on'

    @property
    def safe(self) -> bool:
        """Whether jobs as thin as those of the records run through on this cell."""
        return self.chance >= SURE


def strikes(cell: ArcParams, seen: Steady) -> Strikes | None:
    """seen: of the records. None when no arc of them burned long enough."""
    if not seen.run.size:
        return None
    feed = min(float(np.median(seen.wire[seen.run == k][:ROWS])) for k in np.unique(seen.run))
    contact = float(np.median(seen.contact))
    fed = np.array([feed * WIRE_FACTOR * cell.wire_ratio])
    amps = float(current(cell, fed, np.array([contact]))[0])
    return Strikes(feed, amps, chance(cell, feed, contact), _least(cell, contact))


def chance(cell: ArcParams, feed: float, contact: float) -> float:
    """Share of arcs that burn after the last try. feed: of the bead, m/s (reading); contact: m."""
    arc = Arc.cold(cell, random_state(31, 7))
    struck = 0
    for _ in range(STRIKES):
        struck += _struck(
            p=arc.params[0], state=arc.state, line=arc.line, rng=arc.rng, wire=feed * WIRE_FACTOR, contact=contact
        )  # fmt: skip
    return struck / STRIKES


def _least(cell: ArcParams, contact: float) -> float:
    """Wire feed from which on strikes are sure: more wire, more current."""
    low, high = 0, len(FEEDS)
    while low < high:
        middle = (low + high) // 2
        if chance(cell, float(FEEDS[middle]), contact) >= SURE:
            high = middle
        else:
            low = middle + 1
    return float(FEEDS[low]) if low < len(FEEDS) else math.nan


@jit
def _struck(p, state, line, rng, wire, contact):  # type: ignore[no-untyped-def]
    """One start of an arc with all its tries; whether it burns. wire: command while it strikes, m/s."""
    s = state[0]
    for _ in range(TRIES):
        s.wire, s.reading, s.current, s.flow = 0.0, 0.0, 0.0, 1.0
        line[:] = 0.0
        advance_arc(
            p, s, rng, on=False, gas=True, blocked=False, voltage_set=VOLTAGE, ctwd=contact, dt=STEP
        )
        above = 0
        for _ in range(WAITS):
            advance_wire(p, s, line, rng, command=wire, slip=0.0, empty=False, dt=STEP)
            advance_arc(
                p,
                s,
                rng,
                on=True,
                gas=True,
                blocked=False,
                voltage_set=VOLTAGE,
                ctwd=contact,
                dt=STEP,
            )
            above = above + 1 if s.current_read > ESTABLISHED else 0
            if above >= HOLDS:
                return True
    return False
