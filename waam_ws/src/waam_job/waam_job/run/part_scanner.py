"""Scans the part: the pass over it, the map (once more when it is not believed), and how far it is from its target."""

from __future__ import annotations

import numpy as np

from waam_plan.lay.scanning import scan_segments
from waam_plan.settings import PlanSettings
from waam_process.loop_mode import LoopMode
from waam_process.segment import Kind, Point, Segment

from ..model.cell import LaidBeads, Scan
from ..model.geometry import part_grid
from ..model.goal import Code, JobError
from ..model.program import deviation_of
from ..model.records import State
from .context import JobContext


class PartScanner:
    """Knows the part's box and grid."""

    def __init__(self, context: JobContext) -> None:
        self.context = context
        self.cell, self.motion, self.journal = context.cell, context.motion, context.journal
        self.program, self.goal, self.settings = context.program, context.goal, context.settings
        self.bounds = context.checked.bounds
        self.spec = part_grid(self.bounds, self.settings.resolution, self.settings.margin)
        self._laid: tuple[int, LaidBeads] = (0, LaidBeads())

    def laid(self, layer: int, beads: LaidBeads) -> None:
        """The beads of `layer`, which the scan after it tells the width of."""
        self._laid = layer, beads

    def scan_after(self, layer: int, required: bool = False) -> Scan:
        """The surface after `layer` layers, with its deviation in the status. See `scan`."""
        top = self.program.built_height(layer) if self.program.planned else 0.0
        scan = self.scan(layer, top, required)
        if self.program.planned:
            self._compare(layer, scan)
        return scan

    def scan(self, layer: int, top: float, required: bool) -> Scan:
        """The surface after `layer` layers; `top` is its highest point in a build, m above the plate.

        An implausible map is scanned again once. JobError when it is `required` and still implausible.
        """
        for attempt in (1, 2):
            self.journal.state(State.SCANNING, 'scanning' if attempt == 1 else 'scanning again')
            scan = self._once(layer, top)
            if scan.plausible:
                return scan
            text = f'map after layer {layer}: {"; ".join(scan.reasons)}'
            reaction = 'scanned again' if attempt == 1 else 'correction removed'
            self.journal.note('WARNING', 'scan', text, reaction)
        if required:
            raise JobError(Code.SCAN_FAILED, f'the surface could not be measured: {text}')
        return scan

    def path(self, top: float, settings: PlanSettings, start: Point) -> list[Segment]:
        """The pass over the part from `start`, `top` as of `scan`. JobError when it leaves the machine."""
        m = self.settings.margin
        (x0, y0, _), (x1, y1, z1) = self.bounds.tolist()
        rectangle = (x0 - m, y0 - m, x1 + m, y1 + m)
        highest = z1 if self.goal.mode == 'restore' else top
        try:
            return scan_segments(rectangle, highest, settings, start)
        except ValueError as e:
            raise JobError(Code.PLAN_FAILED, f'the part cannot be scanned: {e}') from None

    def _once(self, layer: int, top: float) -> Scan:
        segments = self.path(top, self.context.plan_settings(), self.motion.position)
        shift = self.motion.next_index - segments[0].index
        segments = [s.at(index=s.index + shift, layer=layer) for s in segments]
        first = next(i for i, s in enumerate(segments) if s.kind == Kind.SCAN)
        if first:  # approach with the laser off: profiles from far above would only be empty
            self.motion.execute(segments[:first])
        number, beads = self._laid
        laid = beads if number == layer else LaidBeads()
        scan_id = self.cell.begin_scan(self.context.run_id, layer, self.spec, laid)
        self.motion.execute(segments[first:])
        return self.cell.finish_scan(scan_id, self.cell.now())

    def _compare(self, layer: int, scan: Scan) -> None:
        """With what was wanted after this layer."""
        status, wanted = self.journal.status, self.program.target_after(layer)
        found = deviation_of(self.program.current, scan.map.z, wanted, self.goal.tolerance)
        status.height_error_rms, status.height_error_max = found.rms, found.max
        self.cell.status(status)
        if layer and found.max > self.settings.height_warning:
            self._note_height(layer, scan, wanted)

    def _note_height(self, layer: int, scan: Scan, wanted: np.ndarray) -> None:
        """The place where the surface is farthest from what was wanted."""
        error = np.where(self.program.current.interior, scan.map.z - wanted, np.nan)
        row, col = np.unravel_index(np.nanargmax(np.abs(error)), error.shape)
        spec = scan.map.spec
        closed = self.goal.loop_mode == LoopMode.CLOSED_LOOP and layer < self.program.total
        self.journal.note(
            'WARNING',
            'height',
            f'{error[row, col] * 1e3:+.2f} mm after layer {layer}',
            'the next layer corrects it' if closed else 'none',
            (float(spec.x[col]), float(spec.y[row]), float(scan.map.z[row, col])),
        )
