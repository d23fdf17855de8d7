"""The operator of the laboratory: whoever waits for one would wait for ever without."""

from __future__ import annotations

from waam_job.run.control import Control

from .machine import Machine

SPOOL_CHANGE_S = 120.0  # simulated; the part cools meanwhile
CHANGES = 5  # of the spool in one job; then something else is wrong


class Operator(Control):
    """Threads new wire when the machine holds for want of it; resumes whatever has paused the job, which its anomalies
    tell."""

    def __init__(self, device: Machine) -> None:
        super().__init__()
        self._device, self._left = device, CHANGES

    @property
    def paused(self) -> bool:
        """False: whoever asks waits no longer, for the wire is threaded meanwhile. JobError ABORTED follows when it
        fails again and again."""
        if super().paused:
            if self._device.bridge.fault:
                self._thread_wire()
            self.resume()
        return False

    def _thread_wire(self) -> None:
        if not self._left:
            self.abort(f'the wire failed again after {CHANGES} changes of the spool')
            return
        self._left -= 1
        self._device.advance(SPOOL_CHANGE_S)
        for fault in ('wire_end', 'wire_slip'):
            self._device.plant.faults.active.pop(fault, None)
