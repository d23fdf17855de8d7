"""What may move the torch in the laboratory."""

from __future__ import annotations

GANTRY, ROBOT = MACHINES = ('gantry', 'robot')
BRIDGES = {GANTRY: 'bridge', ROBOT: 'robot_bridge'}  # node whose parameters count
