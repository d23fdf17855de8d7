"""The simulated robot cell of the laboratory, with its servos, latency and errors.

robot.cell_speed_error_pct: six beads at 10 mm/s on three cells each, how far the true speed of the torch is off on 99 %
of the way that the arc burns; the worst bead; baseline: the same on the gantry. robot.rms_ratio: RMS height error of
the demo's jaw, mean of five seeds; baseline: the gantry on the same seeds.
"""

from __future__ import annotations

import sys

import numpy as np
from lib.emit import emit
from lib.preset import emit_on_cell
from lib.seeds import seeds


def cell_speed() -> None:
    """Six beads, two machines, several cells."""
    from lib.robot_cell import PARTS, speed_off

    off = {
        kind: {
            name: [speed_off(kind, make(), seed) for seed in seeds((3, 12, 13))]
            for name, make in PARTS.items()
        }
        for kind in ('gantry', 'robot')
    }
    for name in PARTS:
        said = ', '.join(
            f'{kind} {min(found[name]):.3%} to {max(found[name]):.3%}'
            for kind, found in off.items()
        )
        print(f'robot.cell_speed_error_pct, {name}: {said}', file=sys.stderr)
    worst = {kind: 100 * max(map(max, found.values())) for kind, found in off.items()}
    emit('robot.cell_speed_error_pct', worst['robot'], '%', 'gantry', worst['gantry'])


def cell_rms() -> None:
    """The jaw on both machines."""
    from lib.jaw import jaw_job

    from waam_lab import over_seeds, run_many

    wanted, rms = seeds((1, 2, 3, 7, 11)), {}
    for kind in ('gantry', 'robot'):
        found = run_many(over_seeds(jaw_job(machine=kind), list(wanted)))
        for r in found:
            said = r.message if r.failed else f'{r.rms * 1e3:.4f} mm, {r.share_in_tolerance:.3f}'
            print(f'robot.rms_ratio, {kind}, seed {r.seed}: {said}', file=sys.stderr)
        rms[kind] = float(np.mean([r.rms for r in found])) * 1e3
    emit_on_cell('robot.rms_ratio', rms['robot'] / rms['gantry'], '1', 'gantry', 1.0)


FIGURES = {'robot.cell_speed_error_pct': cell_speed, 'robot.rms_ratio': cell_rms}
