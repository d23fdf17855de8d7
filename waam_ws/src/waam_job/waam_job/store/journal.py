"""What the job publishes and stores: status, layer records, anomalies, maps and report."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from typing import Any

import numpy as np

from waam_node import job_folder
from waam_node.files import write_atomically
from waam_plan.gcode.program import gcode
from waam_plan.gcode.store import save_plan
from waam_plan.plan import Plan, PlannedLayer
from waam_process.materials import Material
from waam_process.names import FAULTS
from waam_process.safe_files import FileError, Missing
from waam_process.segment import Point

from ..model.cell import Cell, Correction, Scan
from ..model.goal import JobGoal
from ..model.program import PassRecord
from ..model.records import AnomalyRecord, LayerRecord, State, Status
from ..model.stock import needed_area
from ..model.summary import run_summary
from ..model.verdict import Verdict
from . import checkpoint as checkpoints
from .checkpoint import Checkpoint
from .folder import JobFolder
from .trace import trace

TRACK_PERIOD = 10.0  # s, of the telemetry that one piece of the track holds at most within a bead


@dataclass(frozen=True, kw_only=True)
class Following:
    """The layer that follows a scan, and what its setpoints ask for."""

    layer: PlannedLayer
    asked: np.ndarray  # (rows, cols) m of metal
    correction: Correction | None = None  # None: open loop, or the layer is left out
    feed_factor: float = 1.0  # of the wire feed, flow times heat (eq 2.19)


class Journal:
    """Everything goes to its topic and into the folder at the same time.

    run: 1 = first start of the job; passes: the records of the program, which grow while the job runs.
    """

    def __init__(
        self,
        cell: Cell,
        goal: JobGoal,
        folder: JobFolder,
        run: int,
        passes: list[PassRecord],
        material: Material,
    ) -> None:
        self.cell, self.goal, self.folder, self.run = cell, goal, folder, run
        self.material = material
        self._pieces = 0  # of the telemetry track
        self._tracked = 0, -math.inf  # beads done, and when, at the newest piece
        self.status = Status(
            folder.job_id,
            str(folder.path),
            loop_mode=goal.loop_mode,
            material=goal.material,
            k_gain=goal.k_gain,
            passes=max(1, goal.passes),
        )
        self.layers: list[LayerRecord] = []
        self.anomalies: list[AnomalyRecord] = []
        self._anomalies_before = 0  # of the runs before this one
        self.started = cell.now()
        self.models: dict[str, list[int]] = {}
        self.learned: dict[str, Any] = {}  # what former jobs taught, for the report
        self.forecast: dict[str, Any] | None = None  # what `waam forecast` had said of the job
        self.remarks: list[str] = []
        self.spent_before = 0.0  # s of the runs before this one
        # m of wire left after the layers reported; None = not known
        self.spool = goal.wire_left or None
        self.begun = 0.0  # m of wire in a layer that was cut off and is not reported yet
        self.passes = passes
        self.passes_before: list[dict] = []  # what the runs before this one wrote of theirs
        self._before_pause = State.IDLE

    @property
    def elapsed(self) -> float:
        """s of this run"""
        return self.cell.now() - self.started

    def state(self, state: State, message: str = '') -> None:
        """A new phase of the job."""
        self.status.state, self.status.message = state, message
        self.cell.status(self.status)
        self.folder.write_state(job_folder.STATUS, {**asdict(self.status), 'state': state.name})

    def say(self, message: str) -> None:
        """A new message within the phase."""
        if message != self.status.message:
            self.status.message = message
            self.cell.status(self.status)

    def paused(self, paused: bool, why: str = '', class_name: str = 'link') -> None:
        """The job begins (True) or ends to wait for the operator; the state before the pause comes back. why: what has
        held the machine, of this class of anomalies; '' = the operator."""
        if paused:
            self._before_pause = self.status.state
            self.state(
                State.PAUSED,
                f'paused: {why}; resume or abort' if why else 'paused; resume or abort',
            )
            if why:
                self.note('FAULT', class_name, why, 'arc ended, machine held, job paused')
            else:
                self.note('INFO', 'operator', 'paused', 'arc ended, machine held')
        else:
            self.note('INFO', 'operator', 'the pause is over', 'none')
            self.state(self._before_pause)

    def note(
        self,
        severity: str,
        class_name: str,
        text: str,
        reaction: str,
        place: Point | None = None,
    ) -> None:
        """An anomaly, with time and place (m, work frame; None: where the torch is)."""
        position = place or self.cell.machine().position
        layer, bead = self.status.layer, self.status.bead
        anomaly = AnomalyRecord(
            time=self.cell.now(),
            severity=severity,
            class_name=class_name,
            text=text,
            reaction=reaction,
            layer=layer,
            bead=bead,
            position=position,
        )
        self.anomalies.append(anomaly)
        self.cell.anomaly(anomaly)

    def model(self, model_hash: str, layer: int) -> None:
        """Notes which network corrected a layer; explicit laws have no hash."""
        if model_hash:
            self.models.setdefault(model_hash, []).append(layer)

    def heard(self) -> None:
        """Records warnings that other nodes have published meanwhile (a retry of the arc, lines sent again). Faults are
        noted where the job reacts to them."""
        self.anomalies += self.cell.take_warnings()

    @property
    def faulted(self) -> bool:
        """A fault was noted in this run."""
        mine = self.anomalies[self._anomalies_before :]
        return any(a.severity in FAULTS for a in mine)

    def faults_in(self, layer: int) -> int:
        """Faults and alarms while the layer was laid."""
        return sum(a.layer == layer and a.severity in FAULTS for a in self.anomalies)

    def layer(self, record: LayerRecord) -> None:
        """Stores a finished layer; a crash loses nothing of it. A layer that is laid again replaces its record."""
        same = (record.layer, record.final)
        others = [r for r in self.layers if (r.layer, r.final) != same]
        record.add_height_cost(others[-1].arc_on_time if others else 0.0)
        self.layers = [*others, record]
        if self.spool is not None:
            self.spool -= record.wire_used + self.begun
        self.begun = 0.0
        self.cell.layer_report(replace(record))
        self.track()
        self.keep()

    @property
    def wire_left(self) -> float | None:
        """m on the spool, None = not known."""
        return None if self.spool is None else self.spool - self.begun

    def keep(self) -> None:
        """Writes records.json, from which the report of a job that is resumed after a crash is built."""
        self.folder.write_json(
            job_folder.RECORDS,
            {
                'run': self.run,
                'elapsed': self.spent_before + self.elapsed,
                'models': self.models,
                'layers': [asdict(r) for r in self.layers],
                'anomalies': [asdict(a) for a in self.anomalies],
                'passes': [asdict(p) for p in self.passes] or self.passes_before,
                'spool': self.spool,
            },
        )

    def take_over(self, last_layer: int) -> str:
        """Reads records.json of the runs before; what it holds of layers after `last_layer` is laid again. Returns why
        it cannot be used, '' when it can or when there is none."""
        try:
            self._take_over(self.folder.read_yaml(job_folder.RECORDS), last_layer)
        except Missing:
            pass
        except FileError as e:
            return str(e)
        except (KeyError, TypeError, ValueError, AttributeError) as e:
            return f'{job_folder.RECORDS}: damaged ({type(e).__name__}: {e})'
        return ''

    def _take_over(self, data: dict[str, Any], last_layer: int) -> None:
        self.spent_before = float(data.get('elapsed') or 0.0)
        self.models = data.get('models') or {}
        old = [LayerRecord.from_json(r) for r in data.get('layers', [])]
        self.layers = [r for r in old if r.layer <= last_layer and not r.final]
        self.passes_before = data.get('passes') or []
        if data.get('spool') is not None and not self.goal.new_spool:
            self.spool = float(data['spool'])
        before = [AnomalyRecord.from_json(a) for a in data.get('anomalies', [])]
        self.anomalies = before + self.anomalies
        self._anomalies_before += len(before)

    def checkpoint(self, bead: int, beads_done: int, index: int, laid: int) -> None:
        """Writes checkpoint.json: bead being laid (0 = none), beads done, newest index, deposit segments complete."""
        status, temperature = self.status, self.cell.heat().temperature
        now = self.cell.now()
        if not self.folder.passing:
            checkpoints.save(
                self.folder.path,
                Checkpoint(
                    job_id=self.folder.job_id,
                    run=self.run,
                    pass_number=status.pass_number,
                    layer=status.layer,
                    bead=bead,
                    beads_done=beads_done,
                    index=index,
                    laid=laid,
                    time=now,
                    temperature=round(temperature, 1) if math.isfinite(temperature) else None,
                ),
            )
            now = self.cell.now()
        if beads_done != self._tracked[0] or now - self._tracked[1] >= TRACK_PERIOD:
            self._tracked = beads_done, now
            self.track()

    def plan(self, plan: Plan, pass_number: int) -> None:
        """plan.npz and program.gcode; later passes have their number in the name. `plan`: its layers count from 1."""
        folder = self.folder.path
        write_atomically(folder / job_folder.program(pass_number), gcode(plan))
        finished = folder / job_folder.plan(pass_number)
        unfinished = finished.with_name(f'.{finished.name}')
        unfinished.unlink(missing_ok=True)
        save_plan(plan, unfinished)
        unfinished.replace(finished)

    def scan(
        self,
        number: int,
        scan: Scan,
        plan: Plan,
        target: np.ndarray,
        following: Following | None = None,
    ) -> None:
        """Keeps the surface after layer `number`, its target (rows, cols) m, and what comes next."""
        shape = scan.map.spec.shape
        maps = {
            'z': scan.map.z,
            'sigma': np.full(shape, np.nan) if scan.map.sigma is None else scan.map.sigma,
            'count': np.asarray(scan.count, np.uint16),
            'target': target,
            'nominal': plan.nominal.z,
            'planned': following.layer.planned if following else np.zeros(shape),
            'region': plan.region,
            'interior': plan.interior,
            'layer': np.array(number),
            'bead_width': np.array([scan.bead_width, scan.bead_width_u, scan.bead_width_expected]),
        }
        if following and following.correction is not None:
            for name in ('psi', 'confidence', 'residual_height'):
                maps[name] = getattr(following.correction, name)
        if following is None:
            maps['needed'] = needed_area(plan)
        if following:
            maps |= {'asked': following.asked, 'feed_factor': np.array(following.feed_factor)}
        self.folder.write_map(number, scan.map.spec, **maps)

    def track(self) -> None:
        """The telemetry since the last call, thinned to 10 Hz, goes to disk: a long job does not grow in memory, and a
        crash costs no more of it than TRACK_PERIOD."""
        self._pieces += 1
        self.folder.write_track(self.run, self._pieces, self.cell.take_track())

    def report(self, verdict: Verdict) -> None:
        """report.json, and all tracks in one telemetry.npz."""
        self.track()
        self.keep()
        self.folder.join_tracks()
        run = run_summary(
            verdict,
            self.status,
            layers=self.layers,
            anomalies=self.anomalies,
            passes=self.passes,
            material=self.material,
        )
        run |= {'duration_s': self.spent_before + self.elapsed, 'runs': self.run}
        run |= {'forecast': self.forecast}
        goal = self.goal
        self.folder.write_json(
            job_folder.REPORT,
            {
                'job_id': self.folder.job_id,
                'name': goal.title,
                'part': goal.part.name or goal.file.name,
                'material': goal.material,
                'created': datetime.now(UTC).isoformat(timespec='seconds'),
                'tolerance_mm': goal.tolerance * 1e3,
                'verdict': verdict.word,
                'verdict_with_rim': verdict.word_all,
                'trace': self._trace(),
                goal.loop_mode: run,
            },
        )

    def _trace(self) -> dict:
        cell, folder = self.cell, self.folder
        try:
            job = folder.read_yaml(job_folder.JOB)
        except ValueError:  # the report is written whatever else is missing
            job = {}
        facts = trace(self.goal, job, folder.path, cell.parameters(), cell.machine(), self.models)
        return {**facts, 'learned': self.learned, 'remarks': self.remarks}
