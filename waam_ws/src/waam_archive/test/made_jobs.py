"""Makes job folders through the code that real jobs use (waam_job.store), without running one."""

from __future__ import annotations

from dataclasses import asdict
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np

from waam_job.model.records import AnomalyRecord, LayerRecord
from waam_job.store.folder import JobFolder
from waam_process.grid import GridSpec
from waam_process.materials import get

CELL, ROWS, COLS = 1e-3, 24, 30
BEADS, PERIOD = 4, 0.1
FIRST = datetime(2026, 1, 5, 8, tzinfo=UTC)


def make_job(
    jobs: Path, number: int = 1, *, rms: float = 0.1e-3, layers: int = 2, part: str = 'roller.stl',
    operator: str = 'Ada',
    wire_lot: str = '4711', verdict: str = 'in tolerance', job_id: str = '', arrays: bool = True, beads: int = BEADS,
    message: str = '2 layers', created: datetime | None = None,
) -> Path:  # fmt: skip
    """A finished closed-loop job; rms in m. arrays: with maps, plan and telemetry."""
    created = created or FIRST + timedelta(hours=number)
    job_id = job_id or f'{created:%Y%m%dT%H%M%SZ}_{Path(part).stem}_{number}'
    path = Path(jobs) / job_id
    (path / 'layers').mkdir(parents=True)
    folder = JobFolder(path, job_id)
    material = get('er70s-6')
    goal = {
        'part': f'/parts/{part}', 'name': Path(part).stem, 'mode': 'restore', 'loop_mode': 'closed_loop',
        'material': material.name, 'operator_name': operator, 'notes': [f'wire_lot={wire_lot}', 'gas=M21'],
    }  # fmt: skip
    asked = {'job_id': job_id, 'goal': goal, 'material': asdict(material), 'part_sha256': 'ab' * 32}
    folder.write_yaml('job.yaml', asked | {'parameters': {'cell': 'cell1'}})
    records = [layer_record(job_id, n, beads) for n in range(1, layers + 1)]
    records.append(LayerRecord(job_id, layer=layers, final=True, height_error_rms=rms))
    anomalies = [
        AnomalyRecord(1.0, 'WARNING', 'arc', "lost <b>twice</b>; it's 'odd'", 'retry', 1, 2)
    ]
    if arrays:
        write_arrays(folder, layers, beads)
    facts = {
        'job_id': job_id, 'name': Path(part).stem, 'part': part, 'material': material.name,
        'created': created.isoformat(), 'tolerance_mm': 0.2, 'verdict': verdict,
        'trace': trace(operator, wire_lot), 'closed_loop': run(records, anomalies, rms, verdict, message),
    }  # fmt: skip
    folder.write_json('report.json', facts)
    folder.write_json('status.json', {'state': 'FAILED' if verdict == 'failed' else 'DONE'})
    return path


def layer_record(job_id: str, n: int, beads: int) -> LayerRecord:
    return LayerRecord(
        job_id, 'closed_loop', n, temperature=20.0 + 40 * n, current_mean=180.0, voltage_mean=22.0,
        wire_feed_mean=0.08, travel_speed_mean=0.01, energy=39600.0, wire_used=0.8, arc_on_time=10.0,
        arc_starts=beads + (n == 1), height_error_rms=3e-4, law='unet', correction_applied=True,
    )  # fmt: skip


def run(records, anomalies, rms, verdict, message) -> dict:
    rows = [asdict(r) for r in records]

    def total(name):
        return sum(r[name] for r in rows)

    return {
        'rms_mm': rms * 1e3, 'max_mm': 5e3 * rms, 'share_in_tolerance': 0.97, 'verdict': verdict, 'error_code': 0,
        'message': message, 'layers': rows, 'anomalies': [a.to_json() for a in anomalies], 'faults': 0,
        'wire_m': total('wire_used'), 'energy_J': total('energy'), 'arc_on_s': total('arc_on_time'),
        'duration_s': 600.0, 'deposition_kg_h': 2.2, 'cost': 0.5, 'folder': '.',
        'tolerance_map': {'cells': 200, 'in_tolerance': 194, 'above': 4, 'below': 1, 'unseen': 1},
    }  # fmt: skip


def trace(operator: str, wire_lot: str) -> dict:
    return {
        'operator': operator, 'wire_lot': wire_lot, 'gas': 'M21', 'not_told': [], 'material': 'er70s-6',
        'part_sha256': 'ab' * 32, 'programs': {'program.gcode': {'sha256': 'cd' * 32}},
        'software': {'software': 'abc123', 'python': '3.11', 'packages': {'numpy': '2'}},
        'controller': {'identity': 'WAAM_CONTROLLER_V1', 'firmware': '1.2', 'port': '/dev/x'},
        'calibration': {
            'file': 'scanner.yaml', 'date': '2026-01-01T00:00:00+00:00', 'sha256': 'ef' * 32, 'artefact': 'block 3',
            'trouble': '', 'age_days': 4.0, 'mounting': {'mount_xyz': [0.1, 0.0, 0.2], 'mount_rpy': [0.0, 0.0, 0.0]},
        },
        'models': {'f00d': [1, 2]}, 'learned': {}, 'remarks': ['none'],
    }  # fmt: skip


def write_arrays(folder: JobFolder, layers: int, beads: int) -> None:
    """Maps that grow by 1 mm a layer over a region of 20 x 20 mm, telemetry, and a plan of straight beads."""
    spec = GridSpec(0.0, 0.0, CELL, ROWS, COLS)
    region = np.zeros((ROWS, COLS), bool)
    region[2:22, 2:22] = True
    for k in range(layers + 1):
        z = np.where(region, k * 1e-3, 0.0)
        z[0, 0] = np.nan
        target = np.where(region, k * 1e-3, np.nan)
        nominal = np.where(region, layers * 1e-3, np.nan)
        maps = {'z': z, 'target': target, 'nominal': nominal, 'planned': region * 1e-3}
        folder.write_map(k, spec, **maps, region=region, interior=region, layer=np.array(k))
    for n, piece in enumerate(telemetry(layers, beads), 1):
        folder.write_track(1, n, piece)
    folder.join_tracks()
    plan(folder.path, layers, beads)


def telemetry(layers: int, beads: int) -> list[dict[str, np.ndarray]]:
    """One piece per layer: every bead 20 samples with the arc, 5 without."""
    pieces = []
    for layer in range(1, layers + 1):
        n = 25 * beads
        of, phase = np.divmod(np.arange(n), 25)
        arc = phase < 20
        pieces.append(
            {
                't': 1.8e9 + (layer * n + np.arange(n)) * PERIOD, 'x': 2e-3 + 1e-3 * np.minimum(phase, 19),
                'y': 4e-3 + 4e-3 * of, 'z': np.full(n, layer * 1e-3), 'current': arc * (170.0 + of),
                'voltage': arc * 22.0, 'wire_feed': arc * 0.08, 'wire_feed_commanded': arc * 0.08,
                'speed': np.full(n, 0.01), 'temperature': np.full(n, 20.0 + 40 * layer), 'arc': arc.astype(float),
                'layer': np.full(n, float(layer)),
            }
        )  # fmt: skip
    return pieces


def plan(folder: Path, layers: int, beads: int) -> None:
    """The fields of a plan that say where beads lie; numbered from the far side, unlike the order of the arcs."""
    of = [(layer, beads - b, b) for layer in range(1, layers + 1) for b in range(beads)]
    y = np.array([4e-3 + 4e-3 * b for *_, b in of])
    z = np.array([layer * 1e-3 for layer, *_ in of])
    start, end = (np.stack([np.full(len(of), x), y, z], axis=1) for x in (2e-3, 21e-3))
    np.savez_compressed(
        folder / 'plan.npz', kind=np.ones(len(of), np.uint8), layer=np.array([o[0] for o in of]),
        bead=np.array([o[1] for o in of]), start=start, end=end,
    )  # fmt: skip
