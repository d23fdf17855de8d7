"""What a job must be traceable to (ISO/ASTM 52943-2): feedstock, operator, equipment, software, calibration, models."""

from __future__ import annotations

import hashlib
import math
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from waam_node import job_folder

from ..model.goal import JobGoal
from ..model.snapshots import Machine
from . import calibration

ASKED_FOR = ('operator', 'wire_lot', 'gas')  # what only a person knows


def notes_of(goal: JobGoal) -> dict[str, str]:
    """key=value of the goal; a later one of the same key wins."""
    return dict(note.split('=', 1) for note in goal.notes)


def sha256_of(file: Path) -> str:
    """'' when there is no such file."""
    return hashlib.sha256(file.read_bytes()).hexdigest() if file.is_file() else ''


def trace(
    goal: JobGoal,
    job: dict[str, Any],
    folder: Path,
    parameters: dict[str, dict[str, Any]],
    machine: Machine,
    models: dict[str, list[int]],
) -> dict[str, Any]:
    """For report.json. `job`: job.yaml; parameters: of the other nodes; models: hash of the weights -> layers.

    `not_told` names what a person should have entered and did not.
    """
    notes = notes_of(goal)
    scan = parameters.get('scan_fusion', {})
    c = calibration.read(str(scan.get('calibration') or ''))
    people = {
        'operator': goal.operator_name,
        'wire_lot': notes.get('wire_lot', ''),
        'gas': notes.get('gas', ''),
    }
    age = c.age_days(datetime.now(UTC))
    return {
        **people,
        'not_told': [k for k in ASKED_FOR if not people[k]],
        'notes': notes,
        'material': goal.material,
        'part_sha256': job.get('part_sha256', ''),
        'programs': {
            p.name: {'sha256': sha256_of(p)} for p in sorted(folder.glob(job_folder.PROGRAMS))
        },
        'software': {k: job.get(k, '') for k in ('software', 'python', 'system', 'packages')},
        'controller': {
            'identity': machine.identity,
            'firmware': machine.firmware,
            'port': machine.port,
        },
        'calibration': {
            **asdict(c),
            'age_days': None if math.isnan(age) else round(age, 2),
            'mounting': {k: scan.get(k) for k in ('mount_xyz', 'mount_rpy', 'profile_delay')},
        },
        'models': {h: sorted(set(layers)) for h, layers in models.items()},
    }
