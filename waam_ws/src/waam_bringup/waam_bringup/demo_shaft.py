"""The worn shaft of the demo, and the simulated cell that turns it: a chuck in place of the X axis."""

from __future__ import annotations

from pathlib import Path

import yaml

from waam_lab.shafts import WornShaft
from waam_node.files import write_atomically
from waam_process.operating import CHUCK_STEPS
from waam_process.unrolled import LONGEST_AXIS

SHAFT = WornShaft(0.040, 0.060, 0.014, 'eccentric', 2.6e-3, run_out=(0.30e-3, -0.15e-3), turned=2.0)
WORN = 'shaft_worn.npz'


def write(folder: Path, shaft: WornShaft = SHAFT) -> Path:
    """The scan of the worn shaft (`waam_plan.shaft.surfaces`)."""
    file = folder / WORN
    shaft.map().save_npz(file)
    return file


def words(file: Path, shaft: WornShaft = SHAFT) -> list[str]:
    """Of the command line of `waam job run`."""
    return [str(file), '--shaft', f'{shaft.diameter * 1e3:g}', '--ends', f'{shaft.ends * 1e3:g}']


def chuck_params(folder: Path) -> Path:
    """Parameter file of the nodes: what a cell file with `chuck.steps_per_turn` becomes."""
    told = {
        'bridge': {'envelope_x': LONGEST_AXIS},
        'job_sequencer': {'chuck_steps_per_turn': CHUCK_STEPS},
        'cell': {'chuck_steps_per_turn': CHUCK_STEPS},
    }
    file = folder / 'chuck.yaml'
    blocks = {f'/**/{node}': {'ros__parameters': values} for node, values in told.items()}
    write_atomically(file, yaml.safe_dump(blocks))
    return file
