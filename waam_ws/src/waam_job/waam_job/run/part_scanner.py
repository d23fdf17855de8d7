"""Scans the part: the pass over it, the map (once more when it is not believed), and how far it is from its target."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from waam_plan.layers.scanning import scan_segments
from waam_plan.plan import PlannedLayer
from waam_plan.settings import PlanSettings
from waam_process.grid import GridSpec
from waam_process.loop_mode import LoopMode
from waam_process.segment import Kind, Point, Segment

from ..model import changed
from ..model.asked_scan import foreign
from ..model.cell import LaidBeads, Scan
from ..model.geometry import part_grid
from ..model.goal import Code, JobError
from ..model.outlook import reach
from ..model.program import deviation_of
from ..model.records import State
from .context import JobContext

WHOLE = 'whole part scanned: '  # before the reason, in the report
MAX_LOST = (
    0.1  # share of the grid that a scan may lose beside the one before; more is scanned again
)
PARTIAL_SCANS = 3  # in a row, after which the job pauses
PARTIAL = 'what was seen is corrected, the rest holds the level'


class PartScanner:
    """Knows the part's box and grid."""

    def __init__(self, context: JobContext) -> None:
        self.context = context
        self.cell, self.motion, self.journal = context.cell, context.motion, context.journal
        self.program, self.goal, self.settings = context.program, context.goal, context.settings
        self.bounds = context.checked.bounds
        self.spec = part_grid(self.bounds, self.settings.resolution, self.settings.margin)
        self._laid: tuple[int, LaidBeads] = (0, LaidBeads())
        self._kept_since = 0.0  # s, stamp of the last scan of the whole part; 0 = the last one was
        self._coverage = 0.0  # share of the grid that the last whole map knew
        self._partial = 0  # scans in a row that lost more than MAX_LOST of it

    def laid(self, layer: int, beads: LaidBeads) -> None:
        """The beads of `layer`, which the scan after it tells the width of."""
        self._laid = layer, beads

    def scan_after(self, layer: int, required: bool = False) -> Scan:
        """The surface after `layer` layers, with its deviation in the status. See `scan`."""
        top = self.program.built_height(layer) if self.program.planned else 0.0
        return self._compared(layer, self.scan(layer, top, required))

    def scan_after_layer(self, layer: PlannedLayer, before: Scan) -> Scan:
        """The surface after `layer`, which was laid on that of `before`: only what it has changed is scanned, if the
        settings say so and nothing speaks against it; the scan says which (`extent`)."""
        if before.stored:  # what lies there was not planned on one map
            return self.scan_after(layer.number)
        if not self.settings.scan_changed_only:
            return self._witnessed(layer, before)
        window = changed.window_of(self.spec, layer.planned)
        if window is None:
            return self.scan_after(layer.number)
        witnesses = changed.beside(before.map, window, layer.planned)
        if reason := self._whole_because(before) or changed.unwitnessed(witnesses):
            return replace(self.scan_after(layer.number), extent=WHOLE + reason)
        seen = self._scan_window(layer, window)
        if reason := changed.against(before, seen, window, layer.planned):
            self.journal.note('WARNING', 'scan', reason, 'the whole part is scanned')
            return replace(self.scan_after(layer.number), extent=WHOLE + reason)
        self._kept_since = self._kept_since or before.stamp
        share = window.size / before.map.z.size
        text = f'{share:.0%} of the map scanned, what the layer has changed'
        found = replace(changed.joined(before, seen, window), extent=text)
        return self._compared(layer.number, found)

    def _witnessed(self, layer: PlannedLayer, before: Scan) -> Scan:
        """The whole surface after `layer`. Where what lies beside it has moved since the scan `before`, it is scanned
        once more; what two scans say is taken, and told."""
        scan = self.scan_after(layer.number)
        if not (before.plausible and scan.plausible):
            return scan
        moved = changed.moved_beside(before.map, scan.map.z, layer.planned)
        if not abs(moved) > changed.MAX_CHANGE_BESIDE:  # NaN: too few cells tell
            return scan
        self._note_moved(layer.number, moved, 'scanned again')
        again = self.scan_after(layer.number)
        moved = changed.moved_beside(before.map, again.map.z, layer.planned)
        if again.plausible and abs(moved) > changed.MAX_CHANGE_BESIDE:
            self._note_moved(layer.number, moved, 'two scans agree: taken as it is')
        return again

    def _note_moved(self, layer: int, moved: float, reaction: str) -> None:
        text = (
            f'map after layer {layer}: the surface beside the layer moved by {moved * 1e3:+.2f} mm'
        )
        causes = 'part loose or warped, or scanner moved on its mount'
        self.journal.note('WARNING', 'scan', f'{text} ({causes})', reaction)

    def _scan_window(self, layer: PlannedLayer, window: changed.Window) -> Scan:
        top = self.program.built_height(layer.number)
        self.journal.state(State.SCANNING, f'scanning what layer {layer.number} has changed')
        return self._once(layer.number, top, window.spec(self.spec))

    def _whole_because(self, before: Scan) -> str:
        """Why the whole part must be scanned; '' when it need not be."""
        if not before.plausible:
            return 'the map before is not plausible'
        limit = self.settings.scan_max_age
        if limit and not self.cell.now() - (self._kept_since or before.stamp) <= limit:
            return f'parts of the map are older than {limit:.0f} s'
        if self.cell.parameters().get('correction_server', {}).get('hold_width'):
            return 'the bead width is held, and measured against the whole map'
        return ''

    def _compared(self, layer: int, scan: Scan) -> Scan:
        if self.program.planned:
            self._compare(layer, scan)
        return scan

    def scan(self, layer: int, top: float, required: bool) -> Scan:
        """The surface after `layer` layers; `top` is its highest point in a build, m above the plate.

        An implausible map is scanned again once, the other way along: where the ground at one end is out of the
        scanner's range, the pass then ends over metal and shows that the scanner still sees. JobError when it is
        `required` and still implausible.
        """
        seen: np.ndarray | None = None
        partial: Scan | None = None  # a plausible map that misses a part
        for attempt in (1, 2):
            self.journal.state(State.SCANNING, 'scanning' if attempt == 1 else 'scanning again')
            scan = self._once(layer, top, self.spec, backwards=attempt == 2)
            if seen is not None:
                scan = _as_seen_before(scan, seen)
            seen = np.isfinite(scan.map.z)
            if scan.plausible and not self._lost(scan):
                self._kept_since, self._partial = 0.0, 0
                self._coverage = scan.coverage
                return scan
            if scan.plausible and (partial is None or scan.coverage > partial.coverage):
                partial = scan
            text = f'map after layer {layer}: {"; ".join(scan.reasons) or self._lost(scan)}'
            kept = 'correction removed' if partial is None else PARTIAL
            self.journal.note('WARNING', 'scan', text, 'scanned again' if attempt == 1 else kept)
        if partial is not None:
            return self._taken_in_part(layer, partial)
        if required:
            raise JobError(Code.SCAN_FAILED, f'the surface could not be measured: {text}')
        return scan

    def _lost(self, scan: Scan) -> str:
        """What the scan did not see of the map before, in words; '' = no more than MAX_LOST."""
        lost = self._coverage - scan.coverage
        return (
            f'{lost:.1%} of the grid was not seen that was seen before' if lost > MAX_LOST else ''
        )

    def _taken_in_part(self, layer: int, scan: Scan) -> Scan:
        """A map that misses a part twice: what it shows is corrected, the rest holds the level. After PARTIAL_SCANS of
        them the job pauses."""
        self._kept_since = 0.0
        self._partial += 1
        text = f'map after layer {layer}: {self._lost(scan)}'
        if self._partial >= PARTIAL_SCANS and layer < self.program.total:
            self._partial = 0
            self.context.watch.hold(
                f'{text}, and in {PARTIAL_SCANS} layers in a row: clean the window of the scanner and look for what '
                'stands before it, then resume',
                'scan',
            )
        return scan

    def path(
        self,
        top: float,
        settings: PlanSettings,
        start: Point,
        spec: GridSpec | None = None,
        backwards: bool = False,
    ) -> list[Segment]:
        """The pass over the part from `start`, or over a window of its grid, `top` as of `scan`; backwards: from its
        other end. JobError when it leaves the machine."""
        m = self.settings.margin
        (x0, y0, _), (x1, y1, z1) = self.bounds.tolist()
        rectangle = (x0 - m, y0 - m, x1 + m, y1 + m)
        highest = z1 if self.goal.mode == 'restore' else top
        try:
            if spec is None or spec == self.spec:
                return scan_segments(rectangle, highest, settings, start, backwards=backwards)
            x0, x1, y0, y1 = spec.extent
            return scan_segments((x0, y0, x1, y1), highest, settings, start, window=True)
        except ValueError as e:
            raise JobError(Code.PLAN_FAILED, f'the part cannot be scanned: {e}') from None

    def _once(self, layer: int, top: float, spec: GridSpec, backwards: bool = False) -> Scan:
        settings = self.context.plan_settings()
        segments = self.path(top, settings, self.motion.position, spec, backwards)
        shift = self.motion.next_index - segments[0].index
        segments = [s.at(index=s.index + shift, layer=layer) for s in segments]
        first = next(i for i, s in enumerate(segments) if s.kind == Kind.SCAN)
        if first:  # approach with the laser off: profiles from far above would only be empty
            self.motion.execute(segments[:first])
        number, beads = self._laid
        laid = beads if number == layer else LaidBeads()
        begun, job = self.cell.now(), self.context.run_id
        scan_id = self.cell.begin_scan(job, layer, spec, laid)
        self.motion.execute(segments[first:])
        scan = self.cell.finish_scan(scan_id, self.cell.now())
        if reason := foreign(scan, job, layer, spec, begun):
            raise JobError(Code.SCAN_FAILED, f'scan_fusion gave another scan: {reason}')
        return scan

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
        row, col = (int(i) for i in np.unravel_index(np.nanargmax(np.abs(error)), error.shape))
        spec = scan.map.spec
        self.journal.note(
            'WARNING',
            'height',
            f'{error[row, col] * 1e3:+.2f} mm after layer {layer}',
            self._reach(layer, abs(float(error[row, col])), row, col),
            (float(spec.x[col]), float(spec.y[row]), float(scan.map.z[row, col])),
        )

    def _reach(self, layer: int, error: float, row: int, col: int) -> str:
        """Who can still correct an error (m) at a cell after `layer`."""
        program = self.program
        left = program.total - layer
        if self.goal.loop_mode != LoopMode.CLOSED_LOOP or left < 1:
            return 'none'
        rest, after = (program.metal_after(n)[row, col] for n in (layer, layer + 1))
        if error <= reach(rest - after):
            return 'within what the next layer can correct'
        if error <= reach(rest):
            return f'within what the {left} layers left can correct, more than the next one can'
        layers = 'last layer' if left == 1 else f'{left} layers left'
        return f'more than the {layers} can correct'


def _as_seen_before(scan: Scan, seen: np.ndarray) -> Scan:
    """`scan`, doubted where it knows much less than the scan before it, which saw the cells (rows, cols): nothing was
    laid between, so the scanner was blind for a while."""
    lost = float((seen & np.isnan(scan.map.z)).mean())
    if lost <= MAX_LOST:
        return scan
    reason = f'{lost:.1%} of the grid was seen by the scan before, not by this one'
    return replace(scan, plausible=False, reasons=(*scan.reasons, reason))
