"""Wire on the spool against what the running job still needs, from the folder of the job. No ROS."""

from __future__ import annotations

import math
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from waam_node import job_folder
from waam_process.bead import bead_section
from waam_process.safe_files import FileError, parse_json, read_npz

from .history import facts_of

# three restorations on the simulated cell took 0.90 to 1.07 times the wire of their plans
RESERVE = 1.2
FITS, CLOSE, SHORT = 'it fits', 'it is close', 'it is too little'


def spool_of(folder: Path, pass_number: int = 1) -> dict[str, Any] | None:
    """{'layer': after which it is told, 'left_m', 'need_m': of the layers after it, 'words': FITS, CLOSE or SHORT}.

    need_m is by the plan, and in proportion more where the layers so far took more than planned. None where nobody told
    what is on the spool; need_m is None and words '' without a plan that can be read.
    """
    records = facts_of(folder / job_folder.RECORDS)
    asked = facts_of(folder / job_folder.JOB).get('goal')
    left = records.get('spool', asked.get('wire_left') if isinstance(asked, dict) else None)
    if (
        isinstance(left, bool)
        or not isinstance(left, int | float)
        or not math.isfinite(left)
        or left == 0
    ):
        return None
    laid = [r for r in records.get('layers') or [] if isinstance(r, dict) and not r.get('final')]
    numbers = [r['layer'] for r in laid if isinstance(r.get('layer'), int)]
    done = max(numbers, default=0)
    told: dict[str, Any] = {
        'layer': done,
        'left_m': round(float(left), 1),
        'need_m': None,
        'words': '',
    }
    below = [n for r in laid if isinstance(n := r.get('layer'), int) and _pass(r) < pass_number]
    offset = max(below, default=0)  # a stored plan counts its layers from 1
    found = _stored(folder / job_folder.plan(max(1, pass_number)))
    planned = {n + offset: metres for n, metres in found.items()}
    if not planned:
        return told
    took = {r['layer']: r['wire_used'] for r in laid if isinstance(r.get('wire_used'), int | float)}
    both = [n for n in took if n in planned]
    before = sum(planned[n] for n in both)
    more = max(1.0, sum(took[n] for n in both) / before) if before > 0 else 1.0
    need = more * sum(m for n, m in planned.items() if n > done)
    words = SHORT if left < need else CLOSE if left < RESERVE * need else FITS
    return told | {'need_m': round(need, 1), 'words': words}


def _pass(record: dict[str, Any]) -> int:
    number = record.get('pass_number', 1)
    return number if isinstance(number, int) else 1


def _stored(plan: Path) -> dict[int, float]:
    """Read once: a plan is large, is written once, and the page asks every few seconds."""
    try:
        return _planned(plan, plan.stat().st_mtime_ns)
    except OSError:
        return {}


@lru_cache(maxsize=4)
def _planned(plan: Path, _changed_ns: int) -> dict[int, float]:
    """m of wire for every layer of a stored plan: metal of its segments over section of the wire and efficiency."""
    try:
        data = read_npz(plan)
        settings = parse_json(str(data['about']), 'about')['settings']
        section = (
            math.pi / 4 * float(settings['wire_diameter']) ** 2 * float(settings['efficiency'])
        )
        length = np.linalg.norm(data['end'] - data['start'], axis=1)
        metal = bead_section(data['width'], data['height']) * length
        metres = metal * data['arc'].astype(bool) / section
        layer = data['layer']
        return {
            int(n): float(metres[layer == n].sum())
            for n in np.unique(layer[data['arc'].astype(bool)])
        }
    except (FileError, KeyError, IndexError, TypeError, ValueError, ZeroDivisionError):
        return {}
