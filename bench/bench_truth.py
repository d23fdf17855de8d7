"""How near the simulated cell is to recordings: the preset `recorded`, and `gentle` beside it.

Every line is the larger of simulated/recorded and its inverse, from one run over both; the baseline is the same of the
preset `gentle`. `truth.worst_ratio` is the largest of the others. Recordings are those of ../shared/data
(docs/recordings.md); without them nothing is told. Simulated figures are means over seeds; on stderr their values and
scatter between seeds.

Wall (`lib/truth_wall.py`; scans after layers 1 to 3 of `wall_profiles`, 10 mm off the ends, means of the layers):
`truth.top_rms`: crown along the wall, straight line removed; `truth.section`: whole cross-section along it;
`truth.growth`: growth of the crown of layers 2 and 3; `truth.correlation_length`: of the crown; `truth.width`: at half
height; `truth.middle`: lateral wander of the middle at half height. Plate before it: `truth.scan_noise` about a line,
`truth.scan_noise_step` from point to point, `truth.scan_lost`.
Arc (`lib/truth_arc.py`; plate 25 of `arc_logs`, from 2 s after the strike): `truth.current`, `truth.voltage`: sigma;
`truth.current_1s`, `truth.voltage_1s`: of means over 1 s; `truth.arc_correlation`: of both.
`truth.cooling` (`lib/truth_cooling.py`; `interlayer_temperature`): excess temperature 10, 20, 30 s over that 5 s after
the arc, the worst of the three.

One wall of 50 mm has some ten correlation lengths: its own figures scatter by 30 to 60 % between walls of one cell, so
what is here within 1.25 is as near as one wall can tell. `truth.growth` stays at 2.4: the recorded wall grows least
where it stands highest (correlation of growth and crown before it -0.4 and -0.5, errors of placing the scans included),
so its layers scatter by 15 and 18 % while its crown stays within 5 %. The simulated metal evens out no more than its
pool covers; with more scatter `truth.top_rms` and `truth.section` leave 1.25 before growth comes near.

Without a recording here: the error that scans of a robot share (one cloud in `wall_scan`; it takes several: 0.107 mm in
clouds that are kept back), scatter that is common to a layer (three layers; see recorded.yaml), drift of the deposition
efficiency (no recording weighs it), lumps of spatter (none on the wall), warp, the surface of multi-bead layers (no
public scan).
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from lib import truth_arc, truth_cooling, truth_wall
from lib.emit import emit
from lib.seeds import seeds

DATA = Path(__file__).resolve().parents[2] / 'shared' / 'data'
# of walls; arcs take the first eight, cooling (nothing random decides) the first
SEEDS = tuple(range(1, 25))
PRESETS = ('recorded', 'gentle')


def cooling(shares: np.ndarray) -> dict[str, float]:
    pairs = zip(truth_cooling.AFTER[1:], shares, strict=True)
    return {f'cooling_{int(s)}s': float(v) for s, v in pairs}


def over_seeds(name: str, found: list[dict[str, float]]) -> dict[str, float]:
    """Means; they and the scatter go to stderr."""
    mean = {k: float(np.mean([f[k] for f in found])) for k in found[0]}
    for key, value in mean.items():
        scatter = np.std([f[key] for f in found])
        print(f'  {name} {key}: {value:.4g} +- {scatter:.2g}', file=sys.stderr)
    return mean


def measured() -> tuple[dict[str, float], dict[str, dict[str, float]]]:
    """Figures of the recordings, and by preset."""
    from waam_lab import params
    from waam_sim.config import plant_params

    scans, passes = truth_wall.recorded(DATA / 'wall_profiles')
    times, rows = truth_arc.recorded(DATA / 'arc_logs' / 'plate25_weld_params.csv')
    files = sorted((DATA / 'interlayer_temperature').glob('*.csv'))
    real = (
        truth_wall.figures(scans)
        | truth_arc.figures(times, rows)
        | cooling(truth_cooling.recorded(files))
    )
    over_seeds('recorded metal', [real])
    wire, voltage = rows[:, 0].mean(), rows[:, 2].mean()
    wanted, made = seeds(SEEDS), {}
    for preset in PRESETS:
        physics = plant_params(params.make(preset=preset).cell)
        walls = [truth_wall.figures(truth_wall.simulated(physics, passes, s)) for s in wanted]
        arcs = [truth_arc.simulated(physics, times, wire, voltage, s) for s in wanted[:8]]
        arcs = [truth_arc.figures(times, a) for a in arcs]
        told = over_seeds(preset, walls) | over_seeds(preset, arcs)
        made[preset] = told | cooling(truth_cooling.simulated(physics, wanted[0]))
    return real, made


def ratio(simulated: float, recorded: float) -> float:
    """The larger of simulated/recorded and its inverse."""
    return max(simulated / recorded, recorded / simulated)


def truth() -> None:
    """All of it, in one run."""
    if not (DATA / 'wall_profiles').is_dir():
        print(f'{DATA}: no recordings here, nothing to compare with', file=sys.stderr)
        return
    real, made = measured()
    ratios = {p: {k: ratio(made[p][k], real[k]) for k in real} for p in PRESETS}
    for found in ratios.values():
        names = [k for k in found if k.startswith('cooling_')]
        found['cooling'] = max(found.pop(k) for k in names)
    for found in ratios.values():
        found['worst_ratio'] = max(found.values())
    for key, value in ratios['recorded'].items():
        emit(f'truth.{key}', value, '', 'preset gentle', round(ratios['gentle'][key], 4))


NAMES = (
    'top_rms', 'section', 'width', 'middle', 'growth', 'correlation_length', 'scan_noise', 'scan_noise_step',
    'scan_lost', 'current', 'current_1s', 'voltage', 'voltage_1s', 'arc_correlation', 'cooling', 'worst_ratio',
)  # fmt: skip
FIGURES = {f'truth.{name}': truth for name in NAMES}
