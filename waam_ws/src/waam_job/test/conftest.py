"""A cell without processes: moves take no wall time, metal follows a rule of thumb, faults can be scripted."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from waam_job.model.cell import Correction, Heat, Machine, Scan, Sums
from waam_node.stl import write_worn_block
from waam_process.grid import GridSpec, HeightGrid
from waam_process.learned import Taught, parse
from waam_process.segment import Kind

TRAIL = 2e-3  # m, of the melt pool behind the arc
WIRE_AREA, WIRE_EFFICIENCY = np.pi * 0.6e-3**2, 0.92  # of er70s-6


class FakeCell:
    """Implements `waam_job.model.cell.Cell`. `efficiency` is the share of asked metal that arrives; `script` maps a
    segment index to a function of the cell that is called when that segment is reached (to inject faults)."""

    def __init__(
        self, surface: HeightGrid, efficiency: float = 0.85, temperature: float = 25.0
    ) -> None:
        self.surface, self.efficiency = surface, efficiency
        self.time, self.temperature, self.limit = 1000.0, temperature, 165.0
        self.machine_state = Machine(
            connected=True, age=0.0, position=(0.0, 0.0, 0.1), limit_max=(0.4, 0.3, 0.2)
        )
        self.queue: list = []
        self.laid: list = []  # layer, beads told with every scan
        self.pool = None
        self.statuses, self.reports, self.anomalies, self.commands, self.executed = (
            [],
            [],
            [],
            [],
            [],
        )
        self.script: dict = {}
        self.scan_coverage = [1.0] * 100
        self.pyrometer_plausible = True
        self.doubt = ''  # why the temperature is not believed
        self.record_calls: list = []
        self.warnings: list = []
        self.node_parameters: dict = {}
        self.announced: list = []  # (layers reported by then, layer that comes next)
        self.told_learned: list = []  # what every request told of former jobs
        self.tracks_taken = 0
        self.wire, self.arc_time = 0.0, 0.0  # m and s since the last sums
        self.pace = 8  # segments that are executed at once

    def now(self) -> float:
        return self.time

    def wait(self, seconds: float) -> None:
        self.time += seconds
        self.temperature = 25 + (self.temperature - 25) * 0.999
        if self.machine_state.state in ('HOLD', 'ALARM'):
            return
        for _ in range(self.pace):
            if not self.queue:
                self.machine_state = replace(self.machine_state, state='IDLE')
                return
            segment = self.queue.pop(0)
            self.machine_state = replace(
                self.machine_state, state='RUN', executed=segment.index, position=segment.end,
                arc_on=segment.arc, executed_job=self.machine_state.armed_job,
            )  # fmt: skip
            self.executed.append(segment)
            self.time += segment.duration
            self._lay(segment)
            if action := self.script.pop(segment.index, None):
                action(self)
                return

    def on_deposit(self, number: int, action) -> None:
        """Calls `action` when the number-th depositing segment from now on has been laid."""
        inner, seen = self._lay, 0

        def lay(s):
            nonlocal seen
            inner(s)
            if s.kind == Kind.DEPOSIT:
                seen += 1
                if seen == number:
                    action()

        self._lay = lay

    def _lay(self, s) -> None:
        if s.kind != Kind.DEPOSIT:
            self.pool = None
            return
        self.temperature += 0.02
        spec = self.surface.spec
        metal = s.width * 0.73 * s.height * s.flow_factor * s.length / (1 + s.k_gain * s.psi)
        self.wire += metal / (WIRE_AREA * WIRE_EFFICIENCY)
        self.arc_time += s.duration
        row, col = (int(v) for v in spec.cell(*self._pool_under(s)))
        spot = np.zeros(spec.shape)
        spot[row, col] = metal
        window = np.s_[max(0, row - 15) : row + 16, max(0, col - 15) : col + 16]
        added = gaussian_filter(spot[window], 4.5) / spec.resolution**2
        self.surface.z[window] += added * self.efficiency

    def _pool_under(self, s) -> np.ndarray:
        """Where the melt is while segment `s` is laid: `TRAIL` behind the arc, at first under it."""
        torch = np.array(s.midpoint[:2])
        if self.pool is None:
            self.pool = np.array(s.start[:2])
        behind = self.pool - torch
        self.pool = torch + behind * min(1.0, TRAIL / max(np.linalg.norm(behind), 1e-9))
        return self.pool

    def machine(self) -> Machine:
        return self.machine_state

    def parameters(self) -> dict:
        return self.node_parameters

    def take_warnings(self) -> list:
        taken, self.warnings = self.warnings, []
        return taken

    def heat(self) -> Heat:
        ready = self.temperature < self.limit
        return Heat(
            known=True,
            temperature=self.temperature,
            limit=self.limit,
            ready=ready,
            wait=5.0,
            plausible=self.pyrometer_plausible,
            reasons=('stuck',) * (not self.pyrometer_plausible),
            believed=not self.doubt,
            doubt=self.doubt,
        )

    def command(self, name, *, text='', names=(), vector=(0, 0, 0), value=0.0) -> None:
        self.commands.append(name)
        change = {
            'ARM': {'armed_job': text}, 'DISARM': {'armed_job': ''}, 'HOME': {'homed': True},
            'RESUME': {'state': 'RUN', 'fault': 0}, 'HOLD': {'state': 'HOLD', 'fault': 200},
            'SET_ZERO': {'work_offset': tuple(vector)},
            'RESET': {'state': 'IDLE', 'fault': 0, 'homed': False},
        }.get(name, {})  # fmt: skip
        self.machine_state = replace(self.machine_state, **change)
        if name == 'STOP':
            self.queue.clear()

    def enqueue(self, job_id, segments, last) -> None:
        from waam_process.segment import check_chain

        check_chain(segments)
        for s in segments:
            s.check()
        self.queue.extend(segments)
        self.machine_state = replace(self.machine_state, state='RUN')

    def begin_scan(self, job_id, layer, spec: GridSpec, laid) -> int:
        whole = self.surface.spec
        row, col = whole.cell(spec.x[0], spec.y[0])
        self.window = np.s_[int(row) : int(row) + spec.rows, int(col) : int(col) + spec.cols]
        x, y = whole.x[self.window[1]], whole.y[self.window[0]]
        np.testing.assert_allclose(np.r_[x, y], np.r_[spec.x, spec.y], atol=1e-12)
        self.scan_spec = spec
        self.laid.append((layer, laid))
        return layer

    def finish_scan(self, scan_id, until) -> Scan:
        coverage = self.scan_coverage.pop(0)
        z = self.surface.z[self.window].copy()
        grid = HeightGrid(self.scan_spec, z, np.full(z.shape, 1e-5))
        return Scan(
            grid,
            np.ones(z.shape, np.uint16),
            coverage,
            coverage > 0.5,
            () if coverage > 0.5 else ('coverage too low',),
        )

    def correct(self, job_id, request) -> Correction:
        on = request.planned > 0
        planned = np.where(on, request.planned, 1.0)
        wanted = np.where(
            on,
            np.nan_to_num((planned + request.target - request.scan.map.z) / planned, nan=1.0),
            1.0,
        )
        k_gain = 0.3 if np.isnan(request.k_gain) else request.k_gain
        psi = np.clip((1 / np.clip(wanted, 0.2, 5) - 1) / k_gain, -1, 1)
        given = planned / (1 + k_gain * psi)
        residual = np.where(on, planned * wanted - given, 0.0)
        fallback = not request.scan.plausible
        if fallback:
            psi, residual = np.zeros_like(psi), np.zeros_like(psi)
        return Correction(
            psi=psi,
            confidence=np.full_like(psi, not fallback),
            residual_height=residual,
            k_gain=k_gain,
            flow_factor=1.0,
            law='test',
            fallback=fallback,
            reasons=('map refused',) * fallback,
            saturated_cells=0,
            expected_rms=(1e-4, 7e-5, 1.4e-4),
            handle='message',
            learned=self._learned(job_id, request),
        )

    def _learned(self, job_id, request) -> str:
        self.told_learned.append(request.learned)
        if not request.learned:
            return ''
        taught = Taught(self.efficiency, 0.02, request.layer)
        return parse(request.learned).after(taught, job_id).text()

    def setpoints(self, job_id, request) -> list:
        correction = request.correction
        if correction is None or not request.apply:
            return request.segments
        psi = HeightGrid(self.surface.spec, correction.psi)
        residual = HeightGrid(self.surface.spec, correction.residual_height)
        return [
            s.at(psi=float(psi.sample(*s.midpoint[:2])), k_gain=correction.k_gain,
                 height=s.height + float(residual.sample(*s.midpoint[:2])))
            if s.kind == Kind.DEPOSIT else s
            for s in request.segments
        ]  # fmt: skip

    def record(self, start, directory, custom=()) -> str:
        self.record_calls.append(start)
        return 'ok'

    def plan(self, job_id, layer, segments) -> None: ...

    def next_layer(self, job_id, coming) -> None:
        self.announced.append((len(self.reports), coming))

    def take_sums(self) -> Sums:
        """Frames of one second."""
        wire, seconds = self.wire, int(np.ceil(self.arc_time))
        self.wire, self.arc_time = 0.0, 0.0
        return Sums(frames=seconds, arc_frames=seconds, wire=wire, frame_period=1.0)

    def take_track(self) -> dict:
        self.tracks_taken += 1
        t, temperature = float(self.tracks_taken), self.temperature
        return {'t': np.array([t]), 'temperature': np.array([temperature])}

    def status(self, status) -> None:
        self.statuses.append(replace(status))

    def layer_report(self, report) -> None:
        self.reports.append(report)

    def anomaly(self, anomaly) -> None:
        self.anomalies.append(anomaly)


@pytest.fixture
def cell_class() -> type[FakeCell]:
    return FakeCell


@pytest.fixture(scope='session')
def parts(tmp_path_factory) -> tuple[Path, Path]:
    """A small nominal block (40 x 30 x 10 mm) and the same with a worn trough of 4 mm."""
    x, y = np.linspace(0, 40, 21), np.linspace(0, 30, 16)
    gx, gy = np.meshgrid(x, y)
    dip = 4 * np.clip(1.4 - np.hypot((gx - 20) / 14, (gy - 15) / 10), 0, 0.9) / 0.9
    return write_worn_block(tmp_path_factory.mktemp('parts'), x, y, 10.0, dip)


@pytest.fixture
def make_cell(parts):
    """make_cell(**options) -> FakeCell with the worn part on the table."""
    from waam_job.model.geometry import part_grid
    from waam_plan.mesh.part import load_part
    from waam_plan.mesh.surface import top_surface

    def make(**options) -> FakeCell:
        worn = load_part(parts[1], 1e-3)
        spec = part_grid(worn.bounds - worn.bounds[0], 0.5e-3, 5e-3)
        return FakeCell(top_surface(worn.mesh, spec), **options)

    return make


@pytest.fixture
def pit_after():
    """pit_after(cell, layers, depth): the surface sinks by `depth` (m) within 3 mm of the middle of the part whenever
    one of these layers has been laid."""

    def attach(cell: FakeCell, layers, depth: float = 1.2e-3) -> None:
        inner = cell.finish_scan

        def finish_scan(scan_id, until):
            if scan_id in layers:
                x, y = np.meshgrid(cell.surface.spec.x, cell.surface.spec.y)
                cell.surface.z[np.hypot(x - 0.020, y - 0.015) < 3e-3] -= depth
            return inner(scan_id, until)

        cell.finish_scan = finish_scan

    return attach


@pytest.fixture
def make_runner(parts, tmp_path):
    """make_runner(cell, settings={fields of Settings}, **goal fields) -> (runner, control, folder).

    The plan is a zig-zag of three layers, whatever the planner's defaults are, unless the fields say otherwise.
    """
    from waam_job.model.goal import JobGoal, check
    from waam_job.run.control import Control
    from waam_job.run.runner import JobRunner
    from waam_job.run.settings import Settings
    from waam_job.store.folder import JobFolder

    def make(cell, settings=None, **fields):
        plan = {'strategy': 'zigzag', 'plan_settings': ('finish_height=0.00115',)}
        goal = JobGoal(part=parts[0], material='er70s-6', jobs_dir=tmp_path, **(plan | fields))
        folder = JobFolder.create(tmp_path, 'test')
        control = Control()
        own = Settings(lease_nodes=('bridge', 'scan_fusion'), **(settings or {}))
        return JobRunner(cell, check(goal), folder, control, own), control, folder

    return make
