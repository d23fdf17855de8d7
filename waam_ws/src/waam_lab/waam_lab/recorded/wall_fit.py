"""A wall that was scanned before and between its layers, with the robot's log: how much metal came, and how unevenly.

The cross-section that grew between two scans is compared with wire feed over travel speed. No layer is laid anew: the
log does not say where the wire tip was to a millimetre."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from waam_record.foreign.times import spread
from waam_sim.metal_params import MetalParams

from ..twin.records import RecordError
from .finding import Figure, Finding, Parameter
from .read import Recording
from .wall import ArcLog, WallMaps

CELL = 1e-3  # m; profiles are about as far apart
HALF, BESIDE = 7e-3, (8e-3, 12e-3)  # m from the axis: the bead, and the plate that did not grow
ENDS = 10e-3  # m at each end that do not count
SMOOTH = (
    3e-3  # m along the bead over which the cross-section is averaged, about its correlation length
)
# variation of the cross-section of simulated walls over the root of fixed and layer noise squared: 3.05 % with 5.4 %
# (shared/anchors/recorded-against-simulated.md)
SEEN = 0.56
SILENT = (
    'wire diameter and ratio of the measuring wheel: only their product with metal_transfer shows, and metal_transfer '
    'takes it all',
    'whether scatter returns in every layer or not: both noises get the same factor',
    'scatter of the bead width, levelling, pool and start of a bead: the layers are not laid anew',
    'lateral wander of the wire against errors of robot and scanner',
    'temperatures: there was no pyrometer',
)


@dataclass(frozen=True)
class Layer:
    """What grew between two scans, and what was asked for. section: (n,) m² along the inner part of the bead, whole:
    the same of all layers up to here; wire, speed: m/s; layers: how many there are between the scans."""

    section: np.ndarray
    whole: np.ndarray
    wire: float
    speed: float
    layers: int

    @property
    def mean(self) -> float:
        """m² per layer."""
        return float(np.nanmean(self.section)) / self.layers

    @property
    def uneven(self) -> float:
        """Relative standard deviation of the whole cross-section along the bead, its trend taken out."""
        good = np.flatnonzero(np.isfinite(self.whole))
        x = good - good.mean()
        rest = self.whole[good] - np.polyval(np.polyfit(x, self.whole[good], 1), x)
        return float(rest.std() / abs(np.nanmean(self.whole)))


def arc_of(folder: Path, log: ArcLog) -> Recording:
    """The robot's log as a recording; rows whose truncated stamps repeat are spread."""
    t, _ = spread([round(v * 1e9) for v in log.t])
    columns = {
        'wire_feed_speed': log.wire_feed,
        'arc_current': log.current,
        'arc_voltage': log.voltage,
        'arc_established': log.arc.astype(float),
    }
    seconds = np.array(t) * 1e-9
    return Recording(f'{folder.name}/arc_log.csv', seconds - seconds[0], columns, {})


def layers_of(wall: WallMaps, log: ArcLog) -> list[Layer]:
    """One per pair of scans with an arc between them."""
    found = []
    for k in range(1, len(wall.scans)):
        a, b = (float(wall.scans[i].motion.t[0]) for i in (k - 1, k))
        lit = log.arc & (log.t > a) & (log.t < b) & (log.wire_feed > 0) & (log.speed > 0)
        starts = int((np.diff((log.arc & (log.t > a) & (log.t < b)).astype(int)) == 1).sum())
        if lit.sum() < 10 or not starts:
            continue
        section, whole = _section(wall, k, k - 1), _section(wall, k, 0)
        if np.isfinite(section).sum() < 20:
            continue
        wire, speed = (float(np.median(v[lit])) for v in (log.wire_feed, log.speed))
        found.append(Layer(section, whole, wire, speed, starts))
    return found


def _section(wall: WallMaps, k: int, before: int) -> np.ndarray:
    """(n,) m² that grew between two scans along the inner part, averaged over SMOOTH."""
    spec, bead = wall.maps[k].spec, wall.bead
    growth = wall.maps[k].z - wall.maps[before].z
    off = np.abs(spec.y - bead.axis)
    cols = (spec.x > bead.start + ENDS) & (spec.x < bead.end - ENDS)
    inside, beside = off <= HALF, (off >= BESIDE[0]) & (off <= BESIDE[1])
    part = growth[np.ix_(inside, cols)]
    plate = np.nanmedian(growth[np.ix_(beside, cols)]) if beside.any() else 0.0
    seen = np.isfinite(part).mean(axis=0)
    with np.errstate(invalid='ignore', divide='ignore'):
        rows = np.nansum(part - plate, axis=0) / np.where(seen > 0.6, seen, np.nan)
    section = rows * spec.resolution
    size = max(int(round(SMOOTH / spec.resolution)), 1)
    good = np.isfinite(section)
    total = np.convolve(np.where(good, section, 0.0), np.ones(size), 'same')
    count = np.convolve(good.astype(float), np.ones(size), 'same')
    return np.where(count > 0.5 * size, total / np.maximum(count, 1.0), np.nan)


def fit_wall(
    folder: Path, read: tuple[WallMaps, ArcLog], base: MetalParams, wire_ratio: float
) -> tuple[Finding, MetalParams]:
    """read: of `wall.read_wall`. RecordError when no layer lies between two scans."""
    wall, log = read
    found = layers_of(wall, log)
    if not found:
        raise RecordError(f'{folder}: no layer was laid between two scans that show it')
    asked = np.array(
        [f.wire / f.speed * math.pi / 4 * base.wire_diameter**2 * wire_ratio for f in found]
    )
    measured = np.array([f.mean for f in found])
    ratio = float(np.exp(np.mean(np.log(measured / asked))))
    error = (
        float(np.std(np.log(measured / asked)) / math.sqrt(len(found))) if len(found) > 1 else 0.2
    )
    told = 0.5 <= ratio <= 1.0 and error < 0.15
    uneven = float(np.sqrt(np.mean([f.uneven**2 for f in found])))
    usual = SEEN * math.hypot(base.area_noise_fixed, base.area_noise_layer)
    factor = uneven / usual if usual > 0 else 1.0
    fixed, each = (v * factor for v in (base.area_noise_fixed, base.area_noise_layer))
    kept = replace(
        base,
        area_noise_fixed=fixed,
        area_noise_layer=each,
        transfer=ratio if told else base.transfer,
    )
    wide = 1.0 / math.sqrt(
        2 * max(sum(np.isfinite(f.section).sum() for f in found) * CELL / SMOOTH, 2)
    )
    doubt = math.hypot(wide, 0.2)
    parameters = (
        Parameter.relative('metal_transfer', ratio, math.hypot(error, 0.03), base.transfer, told),
        Parameter.relative('metal_area_noise_fixed', fixed, doubt, base.area_noise_fixed, True),
        Parameter.relative('metal_area_noise_layer', each, doubt, base.area_noise_layer, True),
    )
    rms = [
        float(np.sqrt(np.mean((measured - asked * p.transfer) ** 2))) * 1e6 for p in (base, kept)
    ]
    figures = tuple(
        Figure(
            f'cross-section of layer {k}',
            'mm²',
            m * 1e6,
            a * base.transfer * 1e6,
            a * kept.transfer * 1e6,
        )
        for k, (m, a) in enumerate(zip(measured, asked, strict=True), 1)
    )
    shown = Figure(
        'unevenness of the whole cross-section',
        '%',
        100 * uneven,
        100 * usual,
        100 * usual * factor,
    )
    notes = [f'{len(found)} layers between {len(wall.scans)} scans']
    if not told:
        notes.append(
            f'wire feed over travel speed gives {ratio:.2f} of the metal: no transfer of 0.5 to 1'
        )
    notes += [f'left out: {text}' for text in wall.left_out[:5]]
    return (
        Finding(
            folder.name, 'wall', (rms[0], rms[1]), 'mm² of a layer, RMS', parameters, (*figures, shown), SILENT,
            tuple(notes),
        ),
        kept,
    )  # fmt: skip
