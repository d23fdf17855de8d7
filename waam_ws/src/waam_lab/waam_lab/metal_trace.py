"""Listens to a job of the laboratory: what was sent to the machine in which layer."""

from __future__ import annotations

from collections import defaultdict

from waam_process.segment import Segment
from waam_sim.plant import Plant


class MetalTrace:
    """`layers`: number -> segments sent, with their setpoints; 0 = outside of layers."""

    def __init__(self) -> None:
        self.layers: dict[int, list[Segment]] = defaultdict(list)

    def on_segments(self, segments: list[Segment]) -> None:
        """What the job sends to the machine."""
        for s in segments:
            self.layers[s.layer].append(s)

    def on_layer(self, number: int, plant: Plant) -> None:
        """The layer that is laid from now on, 0 = none."""
