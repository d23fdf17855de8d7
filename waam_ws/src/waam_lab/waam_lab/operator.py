"""The operator of the laboratory: whoever waits for one would wait for ever without."""

from __future__ import annotations

from waam_job.run.control import Control

from .machine import Machine

MENDING_S = 120.0  # simulated, to change the spool or to clean the place; the part cools meanwhile
MENDINGS = 5  # in one job; then something else is wrong
MENDED = ('wire_end', 'wire_slip', 'arc_loss')  # faults of the cell that it ends


class Operator(Control):
    """Threads new wire and cleans the place when the machine holds for want of wire or of an arc; resumes whatever has
    paused the job, which its anomalies tell."""

    def __init__(self, device: Machine) -> None:
        super().__init__()
        self._device, self._left = device, MENDINGS

    @property
    def paused(self) -> bool:
        """False: whoever asks waits no longer, for that is mended meanwhile. JobError ABORTED follows when it
        fails again and again."""
        if super().paused:
            if self._device.bridge.fault:
                self._mend()
            self.resume()
        return False

    def _mend(self) -> None:
        if not self._left:
            self.abort(
                f'wire or arc failed again after the operator had mended it {MENDINGS} times'
            )
            return
        self._left -= 1
        self._device.advance(MENDING_S)
        for fault in MENDED:
            self._device.plant.faults.active.pop(fault, None)
