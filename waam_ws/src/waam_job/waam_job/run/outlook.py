"""Holds a job that cannot succeed any more: more layers of the same kind would be scrap."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from waam_plan import finish, masks
from waam_plan.plan import PlannedLayer
from waam_process.loop_mode import LoopMode

from ..model import outlook
from ..model.cell import Scan
from .context import JobContext

REMEDY = (
    'resume lays on all the same; abort, then ask waam forecast PART for a layout that does better (narrower beads), or'
    ' plan it with less overhang'
)
SAGS = 'look whether metal sags there or none arrives (overhang, arc, wire)'

OVERRIDDEN = 0.03  # of the metal per path, from which on an override is named


class Outlook:
    """Looks at the surface after every layer of a closed loop. An operator who resumes is asked again only when the
    error has grown over as many layers once more, or a region has starved over as many; what is out of reach is told
    once."""

    def __init__(self, context: JobContext) -> None:
        self.context = context
        # m, after the layers since the last pause: RMS, and error of the worst region
        self._rms: list[float] = []
        self._worst_region: list[float] = []
        self._grown: list[np.ndarray] = []  # m, by the same layers
        self._asked: list[np.ndarray] = []  # m of metal
        self._told_lost = False

    def after(
        self,
        layer: PlannedLayer,
        scan: Scan,
        before: np.ndarray | None = None,
        asked: np.ndarray | None = None,
        skipped: bool = False,
    ) -> None:
        """Pauses the job when there are layers to come that cannot bring it to its target. before: (rows, cols) m, the
        surface before the layer; asked: m of metal that its setpoints asked for; None = not known. skipped: the
        operator left the layer out, and knows what will be missing."""
        self._told_lost |= skipped
        context, program = self.context, self.context.program
        if context.goal.loop_mode != LoopMode.CLOSED_LOOP or not scan.plausible or program.top_ups:
            return  # of top-ups there are few, and where they lie has nothing to compare with
        error = scan.map.z - program.target_after(layer.number)
        on = program.current.interior & (layer.planned > 0) & np.isfinite(error)
        if not on.any():
            return
        bead = program.current.settings.bead_width / program.current.spec.resolution
        self._rms.append(float(np.sqrt(np.mean(error[on] ** 2))))
        self._worst_region.append(outlook.worst_region(error, on, bead))
        if before is None or asked is None:
            self._grown, self._asked = [], []
        else:
            self._grown.append(scan.map.z - before)
            self._asked.append(asked)
        if layer.number >= program.total:
            return
        checks: tuple[Callable[[PlannedLayer, np.ndarray, np.ndarray], str], ...] = (
            self._starves,
            self._diverges,
            self._lost,
        )
        why = next((text for check in checks if (text := check(layer, error, on))), '')
        if why:
            del self._rms[:-1], self._worst_region[:-1]
            self._grown, self._asked = [], []
            context.watch.hold(why, 'height')

    def _diverges(self, layer: PlannedLayer, error: np.ndarray, on: np.ndarray) -> str:
        thickness = float(np.median(layer.planned[layer.planned > 0]))
        tolerance, more = self.context.goal.tolerance, outlook.REGION_OVER_RMS
        if outlook.diverges(self._rms, tolerance, thickness):
            what, errors = 'the error grows', self._rms
            how = 'mm RMS'
        elif outlook.diverges(self._worst_region, tolerance * more, thickness * more):
            what, errors = 'the error of a region grows', self._worst_region
            how = f'mm over the worst {outlook.REGION:.0%} of the layer'
        else:
            return ''
        grown = ', '.join(f'{v * 1e3:.2f}' for v in errors[-outlook.LAYERS - 1 :])
        return (
            f'{what} from layer to layer: {grown} {how} after layer {layer.number}, '
            f'worst {self._worst(error, on)}; {self._remedy()}'
        )

    def _starves(self, layer: PlannedLayer, error: np.ndarray, on: np.ndarray) -> str:
        n, plan = outlook.LAYERS, self.context.program.current
        if len(self._grown) < n:
            return ''
        bead = plan.settings.bead_width / plan.spec.resolution
        grown, asked = self._grown[-n:], self._asked[-n:]
        poor = outlook.starved(grown, asked, on, bead)
        if not poor.any():
            return ''
        share = float(np.sum(grown, axis=0)[poor].sum() / np.sum(asked, axis=0)[poor].sum())
        return (
            f'a region grows by {share:.0%} of what layers {layer.number - n + 1} to {layer.number} were to lay: '
            f'{masks.largest(poor, plan.spec)}, worst {self._worst(error, poor)}; {SAGS}; {self._remedy()}'
        )

    def _lost(self, layer: PlannedLayer, error: np.ndarray, on: np.ndarray) -> str:
        context, program = self.context, self.context.program
        plan, rest = program.current, program.metal_after(layer.number)
        more = not program.last_pass or plan.settings.finish == finish.MACHINED
        if self._told_lost or more:  # a further pass or a top-up lays what is missing
            return ''
        judged = plan.interior & np.isfinite(error)
        out = judged & outlook.lost(error, rest, context.goal.tolerance)
        if not outlook.too_much(out, judged, context.settings.share_in_tolerance):
            return ''
        self._told_lost = True
        left = program.total - layer.number
        most = float(np.max(outlook.reach(rest)[out])) * 1e3
        return (
            f'{out.sum() / judged.sum():.0%} of the judged area cannot be brought to its target any more: with {left} '
            f'more to come, layers correct {most:.2f} mm there at most, worst {self._worst(error, out)}; '
            + self._remedy()
        )

    def _worst(self, error: np.ndarray, on: np.ndarray) -> str:
        spec = self.context.program.current.spec
        row, col = np.unravel_index(np.argmax(np.where(on, np.abs(error), -1.0)), error.shape)
        x, y = spec.x[col] * 1e3, spec.y[row] * 1e3
        return f'{error[row, col] * 1e3:+.2f} mm at x {x:.0f}, y {y:.0f} mm'

    def _remedy(self) -> str:
        """What a person can do; an override comes first, since it changes the metal behind the loop's back."""
        (speed, wire), metal = self.context.control.factors, self.context.control.metal_factor
        if abs(metal - 1.0) < OVERRIDDEN:
            return REMEDY
        return (
            f'an override is in force (speed {speed:.0%}, wire {wire:.0%}: {metal:.2f} x the metal): set both to 100 '
            f'%, then resume; {REMEDY}'
        )
