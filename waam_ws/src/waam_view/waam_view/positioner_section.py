"""How the positioner of a robot held the part, for the report of a job; nothing for a gantry."""

from __future__ import annotations

from html import escape
from typing import Any

import numpy as np

from waam_robot.turning import Turning

from .job_data import Job


def positioner_section(job: Job) -> str:
    """HTML; '' for a job that was not laid by a robot."""
    nodes = job.asked.get('nodes') or {}
    bridge = next((v for v in nodes.values() if isinstance(v, dict) and 'positioner' in v), None)
    return '' if bridge is None else f'<h2>Positioner</h2><p>{escape(_held(bridge))}</p>'


def _held(bridge: dict[str, Any]) -> str:
    """By the parameters of the bridge."""
    start, x, y = map(float, bridge.get('turning') or (0.0, 0.0, 0.0))
    turning, tilt = Turning(start, (x, y)), float(bridge.get('tilt') or 0.0)
    if not turning.still:
        return (
            f'It turned the level part while the torch went: by {turning.text} from the middle of the box, beside '
            'where it stands at rest.'
        )
    if tilt:
        return f'It held the part still, tilted by {np.degrees(tilt):.1f} deg towards the robot.'
    return 'It held the part still and level.'
