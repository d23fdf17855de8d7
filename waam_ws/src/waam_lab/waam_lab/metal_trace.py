"""What happened while a layer was laid, exchange by exchange (10 ms): torch, arc, wire, melt and pool."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from waam_process.grid import GridSpec, HeightGrid
from waam_process.segment import Kind, Segment
from waam_sim.plant import Plant

COLUMNS = ('x', 'y', 'lit', 'wire', 'melt', 'pool_x', 'pool_y', 'width')


@dataclass
class LayerTrace:
    """One layer. `rows`: one tuple of COLUMNS per exchange: torch (m, work frame), 1 while the arc burns, wire that
    really ran (m/s), metal laid (m3), middle of the pool (m) and its width (m)."""

    segments: list[Segment] = field(default_factory=list)
    rows: list[tuple[float, ...]] = field(default_factory=list)
    before: np.ndarray | None = None  # true surface (m) on the cells of `spec`
    after: np.ndarray | None = None
    spec: GridSpec | None = None
    planned: HeightGrid | None = None  # metal to add (m), on the grid of the plan

    @property
    def bead_width(self) -> float:
        """m, of the plan. ValueError when nothing was laid."""
        for s in self.segments:
            if s.kind == Kind.DEPOSIT:
                return s.width
        raise ValueError('no metal was laid in this layer')

    def columns(self) -> dict[str, np.ndarray]:
        """Every column as an array (n,)."""
        table = np.array(self.rows, float).reshape(-1, len(COLUMNS))
        return dict(zip(COLUMNS, table.T, strict=True))


class MetalTrace:
    """Listens to a cell of the laboratory while metal is laid. `layers`: number -> what was seen of it."""

    def __init__(self) -> None:
        self.layers: dict[int, LayerTrace] = {}
        self._number = 0

    def on_segments(self, segments: list[Segment]) -> None:
        """What the job sends to the machine, with its setpoints."""
        for s in segments:
            self._of(s.layer).segments.append(s)

    def on_layer(self, number: int, plant: Plant) -> None:
        """The layer that is laid from now on, 0 = none."""
        if number == self._number:
            return
        if self._number:
            self._of(self._number).after = plant.metal.z.copy()
        if number and self._of(number).before is None:
            layer = self._of(number)
            layer.before, layer.spec = plant.metal.z.copy(), plant.metal.spec
        self._laid = plant.metal.deposited
        self._number = number

    def on_exchange(self, samples: np.ndarray, plant: Plant) -> None:
        """samples (n,) of waam_process.plant_port.SAMPLE that the plant has just lived through."""
        if not self._number:
            return
        metal, zero = plant.metal.state[0], plant.params.work_zero
        laid = plant.metal.deposited
        row = (
            -float(samples['table_x'].mean()) - zero[0],
            -float(samples['table_y'].mean()) - zero[1],
            float(plant.arc_on),
            float(plant.arc.state['wire'][0]),
            laid - self._laid,
            float(metal['pool_x']),
            float(metal['pool_y']),
            float(metal['width']),
        )
        self._laid = laid
        self._of(self._number).rows.append(row)

    def on_planned(self, number: int, planned: HeightGrid) -> None:
        """The metal (m) that layer `number` was to add, on the grid of the plan."""
        self._of(number).planned = planned

    def _of(self, number: int) -> LayerTrace:
        return self.layers.setdefault(number, LayerTrace())
