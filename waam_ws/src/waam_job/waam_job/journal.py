"""What the job says and keeps: status, layer records, anomalies, maps and report, on topics and in the folder."""

from __future__ import annotations

from dataclasses import asdict, replace
from datetime import UTC, datetime

import numpy as np

from waam_plan.plan import Plan, PlannedLayer
from waam_plan.posts import gcode
from waam_process.segment import Segment

from .cell import Cell, Correction, Scan
from .folder import JobFolder
from .geometry import Deviation
from .goal import JobGoal
from .records import AnomalyRecord, LayerRecord, State, Status
from .summary import run_summary


class Journal:
    """Every fact goes out on its topic and into the folder at the same time."""

    def __init__(self, cell: Cell, goal: JobGoal, folder: JobFolder) -> None:
        self.cell, self.goal, self.folder = cell, goal, folder
        self.status = Status(folder.job_id, str(folder.path), profile=goal.profile)
        self.layers: list[LayerRecord] = []
        self.anomalies: list[AnomalyRecord] = []
        self.started = cell.now()
        self._before_pause = State.IDLE

    def state(self, state: State, message: str = '') -> None:
        """A new phase of the job."""
        self.status.state, self.status.message = state, message
        self.cell.status(self.status)
        self.folder.write_json('status.json', {**asdict(self.status), 'state': state.name})

    def say(self, message: str) -> None:
        """A new message within the phase."""
        if message != self.status.message:
            self.status.message = message
            self.cell.status(self.status)

    def paused(self, paused: bool) -> None:
        if paused:
            self._before_pause = self.status.state
            self.state(State.PAUSED, 'paused; resume or abort')
        else:
            self.state(self._before_pause)

    def note(self, severity: str, class_name: str, text: str, reaction: str) -> None:
        """An anomaly, with time and place."""
        position = self.cell.machine().position
        layer, bead = self.status.layer, self.status.bead
        anomaly = AnomalyRecord(
            self.cell.now(), severity, class_name, text, reaction, layer, bead, position
        )
        self.anomalies.append(anomaly)
        self.cell.anomaly(anomaly)

    def faults_in(self, layer: int) -> int:
        return sum(a.layer == layer and a.severity in ('FAULT', 'ALARM') for a in self.anomalies)

    def layer(self, record: LayerRecord) -> None:
        self.layers.append(record)
        self.cell.layer_report(replace(record))

    def checkpoint(self, segment: Segment) -> None:
        """The bead that is being laid: everything before it is done."""
        self.folder.write_json(
            'checkpoint.json',
            {
                'job_id': self.folder.job_id,
                'layer': segment.layer,
                'bead': segment.bead,
                'index': segment.index,
            },
        )

    def plan(self, plan: Plan) -> None:
        """program.gcode and plan.npz."""
        everything = [s for layer in plan.layers for s in layer.segments]
        (self.folder.path / 'program.gcode').write_text(gcode(plan))
        np.savez_compressed(
            self.folder.path / 'plan.npz',
            start=np.array([s.start for s in everything]),
            end=np.array([s.end for s in everything]),
            layer=np.array([s.layer for s in everything]),
            bead=np.array([s.bead for s in everything]),
            kind=np.array([int(s.kind) for s in everything]),
            height=np.array([s.height for s in everything]),
        )

    def scan(
        self,
        number: int,
        scan: Scan,
        plan: Plan,
        target: np.ndarray,
        layer: PlannedLayer | None = None,
        correction: Correction | None = None,
    ) -> None:
        """layers/scan_NNN.npz (docs/job_folder.md): the surface after layer `number`, and what comes next."""
        shape = scan.map.spec.shape
        maps = {
            'z': scan.map.z,
            'sigma': np.full(shape, np.nan) if scan.map.sigma is None else scan.map.sigma,
            'count': np.asarray(scan.count, np.uint16),
            'target': target,
            'nominal': plan.nominal.z,
            'planned': layer.planned if layer else np.zeros(shape),
            'region': plan.region,
            'interior': plan.interior,
            'layer': np.array(number),
        }
        if correction is not None:
            for name in ('psi', 'confidence', 'residual_height'):
                maps[name] = getattr(correction, name)
        self.folder.write_map(number, scan.map.spec, **maps)

    def track(self) -> None:
        """telemetry.npz, thinned to 10 Hz."""
        track = self.cell.take_track()
        if track:
            np.savez_compressed(self.folder.path / 'telemetry.npz', **track)

    def report(self, in_tolerance: bool, final: Deviation | None, as_found_rms: float) -> None:
        """report.json."""
        verdict = 'in tolerance' if in_tolerance else 'out of tolerance'
        if self.status.state != State.DONE:
            verdict = 'failed'
        run = run_summary(verdict, self.status, final, as_found_rms, self.layers, self.anomalies)
        run['duration_s'] = self.cell.now() - self.started
        goal = self.goal
        self.folder.write_json(
            'report.json',
            {
                'job_id': self.folder.job_id,
                'name': goal.title,
                'part': goal.part.name,
                'material': goal.material,
                'created': datetime.now(UTC).isoformat(timespec='seconds'),
                'tolerance_mm': goal.tolerance * 1e3,
                'verdict': verdict,
                goal.profile: run,
            },
        )
