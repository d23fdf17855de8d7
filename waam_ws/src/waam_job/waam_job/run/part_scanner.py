"""Scans the part: the pass over it, the map, and once more when the map is not believed."""

from __future__ import annotations

from waam_plan.lay.scanning import scan_segments
from waam_plan.settings import PlanSettings
from waam_process.segment import Kind, Point, Segment

from ..model.cell import Cell, Scan
from ..model.geometry import part_grid
from ..model.goal import Checked, Code, JobError
from ..model.records import State
from ..store.journal import Journal
from .motion import Motion


class Surveyor:
    """Knows the part's box and grid. `run_id` names the scans towards scan_fusion."""

    def __init__(
        self,
        cell: Cell,
        motion: Motion,
        journal: Journal,
        checked: Checked,
        run_id: str,
        resolution: float,
        margin: float,
    ) -> None:
        self.cell, self.motion, self.journal, self.run_id = cell, motion, journal, run_id
        bounds = checked.part.bounds
        self.size = bounds[1] - bounds[0]
        self.restoring = checked.goal.mode == 'restore'
        self.margin = margin
        self.spec = part_grid(bounds, resolution, margin)

    def scan(self, layer: int, top: float, settings: PlanSettings, required: bool) -> Scan:
        """The surface after `layer` layers; `top` is its highest point in a build, m above the plate.

        An implausible map is scanned again once. JobError when it is `required` and still implausible.
        """
        for attempt in (1, 2):
            self.journal.state(State.SCANNING, 'scanning' if attempt == 1 else 'scanning again')
            scan = self._once(layer, top, settings)
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
        m = self.margin
        rectangle = (-m, -m, float(self.size[0]) + m, float(self.size[1]) + m)
        highest = float(self.size[2]) if self.restoring else top
        try:
            return scan_segments(rectangle, highest, settings, start)
        except ValueError as e:
            raise JobError(Code.PLAN_FAILED, f'the part cannot be scanned: {e}') from None

    def _once(self, layer: int, top: float, settings: PlanSettings) -> Scan:
        segments = self.path(top, settings, self.motion.position)
        shift = self.motion.next_index - segments[0].index
        segments = [s.at(index=s.index + shift, layer=layer) for s in segments]
        first = next(i for i, s in enumerate(segments) if s.kind == Kind.SCAN)
        if first:  # approach with the laser off: profiles from far above would only be empty
            self.motion.execute(segments[:first])
        scan_id = self.cell.begin_scan(self.run_id, layer, self.spec)
        self.motion.execute(segments[first:])
        return self.cell.finish_scan(scan_id, self.cell.now())
