"""Holds a job whose error grows from layer to layer: more layers of the same kind would be scrap."""

from __future__ import annotations

import numpy as np

from waam_plan.plan import PlannedLayer
from waam_process.loop_mode import LoopMode

from ..model import outlook
from ..model.cell import Scan
from .context import JobContext

REMEDY = (
    'resume lays on all the same; abort, then plan it with narrower beads, another layout (waam lab PART --choose) or'
    ' less overhang'
)

OVERRIDDEN = 0.03  # of the metal per path, from which on an override is named


class Outlook:
    """Looks at the surface after every layer of a closed loop. An operator who resumes is asked again only when the
    error has grown over as many layers once more."""

    def __init__(self, context: JobContext) -> None:
        self.context = context
        self._rms: list[float] = []  # m, after the layers since the last pause

    def after(self, layer: PlannedLayer, scan: Scan) -> None:
        """Pauses the job when the error has grown over outlook.LAYERS layers and there are more to come."""
        context, program = self.context, self.context.program
        if context.goal.loop_mode != LoopMode.CLOSED_LOOP or not scan.plausible:
            return
        error = scan.map.z - program.target_after(layer.number)
        on = program.current.interior & (layer.planned > 0) & np.isfinite(error)
        if not on.any():
            return
        self._rms.append(float(np.sqrt(np.mean(error[on] ** 2))))
        thickness = float(np.median(layer.planned[layer.planned > 0]))
        last = layer.number >= program.total
        if last or not outlook.diverges(self._rms, context.goal.tolerance, thickness):
            return
        row, col = np.unravel_index(np.argmax(np.where(on, np.abs(error), -1.0)), error.shape)
        x, y = scan.map.spec.x[col] * 1e3, scan.map.spec.y[row] * 1e3
        grown = ', '.join(f'{v * 1e3:.2f}' for v in self._rms[-outlook.LAYERS - 1 :])
        worst = f'{error[row, col] * 1e3:+.2f} mm at x {x:.0f}, y {y:.0f} mm'
        del self._rms[:-1]
        context.watch.hold(
            f'the error grows from layer to layer: {grown} mm RMS after layer {layer.number}, worst {worst}; '
            + self._remedy(),
            'height',
        )

    def _remedy(self) -> str:
        """What a person can do; an override comes first, since it changes the metal behind the loop's back."""
        (speed, wire), metal = self.context.control.factors, self.context.control.metal_factor
        if abs(metal - 1.0) < OVERRIDDEN:
            return REMEDY
        return (
            f'an override is in force (speed {speed:.0%}, wire {wire:.0%}: {metal:.2f} x the metal): set both to 100 '
            f'%, then resume; {REMEDY}'
        )
