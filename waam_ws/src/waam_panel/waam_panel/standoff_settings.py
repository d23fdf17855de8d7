"""What the page *Standoff* sets: pure values between the web server and the graph."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class StandoffSettings:
    """Of the controller's standoff control; m. distance: NaN = what fits the source. wander: standard deviation of what
    contact tip and wire do to the current of the arc, as a distance; 0 = steady."""

    source: str
    law: str
    distance: float
    up: float
    down: float
    wander: float
