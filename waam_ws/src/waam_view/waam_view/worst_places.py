"""The worst places of a part, finished or in work, and what the recorded data shows as their cause."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.ndimage import distance_transform_edt

from waam_node import job_folder
from waam_process.grid import GridSpec
from waam_process.loop_mode import LoopMode
from waam_process.safe_files import is_file

from .beads import arc_ends
from .job_data import Job, Scan, find_value, interpass_limit, load_scan, number, read_asked

COUNT = 3
LAYERS_BACK = 5  # of a running job, that are looked at for what led to a place
BEAD_WIDTH = 6e-3  # m, of a job that does not say its own
SHARE = 0.3  # of the error that a cause must account for to be named
LEAST = 0.05e-3  # m, below which a difference of two scans says nothing
LIMIT_PSI = 0.98  # of the correction: at its end
AROUND = 1.1  # cells: the place and its four neighbours
STEP = 1e-3  # m, by which nominal must change from cell to cell to be called a step
UNSEEN = 0.2  # share of the cells around a place


@dataclass(frozen=True)
class Place:
    """One place. mm in the work frame; value: what it was ranked by; errors: after every scan, against its target."""

    x_mm: float
    y_mm: float
    z_mm: float  # measured there
    value_mm: float
    errors_mm: list[float]
    causes: list[str]

    def words(self) -> str:
        """Where, how much, since when and why, in one line."""
        before = [f'{e:+.2f}' for e in self.errors_mm[:-1] if math.isfinite(e)]
        said = f'{self.value_mm:+.2f} mm at x {self.x_mm:.1f}, y {self.y_mm:.1f} mm'
        if before:
            said += f' (after the scans before: {", ".join(before)})'
        return f'{said}: {"; ".join(self.causes) or "cause not known"}'


@dataclass(frozen=True)
class LayerError:
    """What is wrong after a layer of a running job."""

    error: (
        np.ndarray
    )  # (rows, cols) m, surface minus the one wanted after the layer; NaN where one is unknown
    judged: np.ndarray  # bool (rows, cols), what counts for the tolerance
    places: list[Place]

    def share_beyond(self, reach: float) -> float:
        """0..1 of the judged cells: error beyond +-reach, m. 0 when none is known."""
        known = self.error[self.judged & np.isfinite(self.error)]
        return float((np.abs(known) > reach).mean()) if known.size else 0.0


def error_after(folder: Path, layer: int, spec: GridSpec, z: np.ndarray) -> LayerError | None:
    """The surface z (rows, cols) m on `spec`, measured after `layer`, against the one that the job wants there.

    None while the job has not written what it wants, or for another grid. The surface in the job's file is not used:
    it may be that of another scan after the same layer.
    """
    scans = [
        scan
        for n in range(max(0, layer - LAYERS_BACK), layer + 1)
        if is_file(file := Path(folder) / job_folder.map_after(n)) and (scan := load_scan(file, []))
    ]
    if not scans or scans[-1].layer != layer:
        return None
    last = scans[-1]
    if GridSpec(*last.origin, last.resolution, *last.z.shape) != spec:
        return None
    scans[-1] = last = replace(last, maps={**last.maps, 'z': z})
    asked = read_asked(Path(folder), [])
    mode = str(find_value(asked, 'loop_mode') or LoopMode.CLOSED_LOOP.value)
    job = Job(Path(folder), mode, report={}, run={}, scans=scans, asked=asked)
    return LayerError(
        last.error, last.interior, _places(job, np.where(last.interior, last.error, np.nan), 0)
    )


def is_machined(job: Job) -> bool:
    """Whether the job was judged by what is left to machine."""
    return bool(job.run.get('stock')) and bool(job.scans) and 'needed' in job.scans[-1].maps


def bead_width(job: Job) -> float:
    """m, of the material of the job."""
    value = number(find_value(job.asked.get('material') or {}, 'bead_width'))
    return value if value > 0 else BEAD_WIDTH


def worst_places(job: Job) -> list[Place]:
    """At most three, two bead widths or more apart, the worst first.

    Finish machined: where the least is left to machine (value: stock, below 0 = metal is missing). Else the largest
    deviations from nominal inside the judged area.
    """
    if not job.scans:
        return []
    last, machined = job.scans[-1], is_machined(job)
    if machined:
        return _places(
            job, np.where(last.maps['needed'].astype(bool), last.final_error, np.nan), -1
        )
    return _places(job, np.where(last.interior, last.final_error, np.nan), 0)


def _places(job: Job, value: np.ndarray, sign: int) -> list[Place]:
    """The worst of value, (rows, cols) m: what is low for sign -1, high for 1, both for 0. NaN does not count."""
    last = job.scans[-1]
    badness = sign * value if sign else np.abs(value)
    rows, cols = np.mgrid[: value.shape[0], : value.shape[1]]
    apart = 2 * bead_width(job) / last.resolution
    found: list[Place] = []
    while len(found) < COUNT and np.isfinite(badness).any():
        row, col = (int(i) for i in np.unravel_index(np.nanargmax(badness), badness.shape))
        found.append(_place(job, row, col, float(value[row, col])))
        badness = np.where(np.hypot(rows - row, cols - col) < apart, np.nan, badness)
    return found


def _place(job: Job, row: int, col: int, value: float) -> Place:
    last = job.scans[-1]
    d, (x, y) = last.resolution, last.origin
    around = _disc(last, row, col, AROUND * last.resolution)
    same = [s for s in job.scans if s.z.shape == last.z.shape]
    at = (x + (col + 0.5) * d, y + (row + 0.5) * d)
    errors = [_mean(s.error, around) * 1e3 for s in same]
    causes = _causes(job, same, around, at, value)
    return Place(
        at[0] * 1e3, at[1] * 1e3, float(last.z[row, col]) * 1e3, value * 1e3, errors, causes
    )


def _disc(scan: Scan, row: int, col: int, radius: float) -> np.ndarray:
    """bool (rows, cols): cells within radius, m, of a cell; the cell itself at least."""
    rows, cols = np.mgrid[: scan.z.shape[0], : scan.z.shape[1]]
    return np.hypot(rows - row, cols - col) * scan.resolution <= radius


def _mean(values: np.ndarray, where: np.ndarray) -> float:
    known = values[where & np.isfinite(values)]
    return float(known.mean()) if known.size else math.nan


def _causes(
    job: Job, scans: list[Scan], around: np.ndarray, at: tuple[float, float], value: float
) -> list[str]:
    """Of the last layer: target - z before it was needed, `asked` was set, the difference of the scans came."""
    if len(scans) < 2 or not scans[-1].layer:
        return []
    before, last = scans[-2], scans[-1]
    error = _mean(last.error, around)
    side = math.copysign(1.0, value if not math.isfinite(error) else error)
    share = max(LEAST, SHARE * abs(error)) if math.isfinite(error) else LEAST
    found = _not_planned(scans, around)
    asked = before.maps.get('asked')
    if asked is not None and 'target' in last.maps:
        needed = _mean(last.maps['target'] - before.z, around)
        left, came = _mean(asked, around) - needed, _mean(last.z - before.z - asked, around)
        if side * left > share:
            found.append(_limit(job, before, around, left))
        if side * came > share:
            why = _why_it_came_so(job, last, at)
            found += [
                f'the layer gave {_mm(came)} than was set',
                *(why or ['cause of that not known']),
            ]
    return found + _step(last, around) + _unseen(before, around)


def _step(last: Scan, around: np.ndarray) -> list[str]:
    """An edge of the part: what stands beside it decides what a cell shows."""
    nominal = last.maps.get('nominal', np.full(last.z.shape, np.nan))[around]
    rise = float(np.nanmax(nominal) - np.nanmin(nominal)) if np.isfinite(nominal).any() else 0.0
    return (
        [f'edge or step of the part: nominal changes by {rise * 1e3:.1f} mm there']
        if rise > STEP
        else []
    )


def _not_planned(scans: list[Scan], around: np.ndarray) -> list[str]:
    planned = [_mean(s.maps['planned'], around) for s in scans[:-1] if 'planned' in s.maps]
    return ['no bead was planned there'] if planned and max(planned) <= 0 else []


def _limit(job: Job, before: Scan, around: np.ndarray, left: float) -> str:
    """Why the layer was not set to what was needed; left: m, what was set minus what was needed."""
    if job.loop_mode != LoopMode.CLOSED_LOOP:
        return f'no correction was applied ({job.loop_mode.replace("_", " ")})'
    told = f'layer {before.layer + 1} was set {_mm(left)} than the target needed'
    psi = _mean(before.maps.get('psi', np.full(before.z.shape, np.nan)), around)
    if psi * left >= LIMIT_PSI * abs(left):  # travel at its end on the side that would help
        return f'limit of correction: travel as {"slow" if psi < 0 else "fast"} as allowed; {told}'
    return f'{told}; what held it back is not recorded'


def _mm(difference: float) -> str:
    return f'{abs(difference) * 1e3:.2f} mm {"more" if difference > 0 else "less"}'


def _why_it_came_so(job: Job, last: Scan, at: tuple[float, float]) -> list[str]:
    """What lay within a bead width of the place while the last layer was laid."""
    near, found = bead_width(job), []
    t = job.telemetry
    if t:
        for word, x, y in arc_ends(t, last.layer):
            distance = math.hypot(x - at[0], y - at[1])
            if distance < near:
                found.append(f'{word}, {distance * 1e3:.1f} mm away')
                break
    found += _too_hot(job, last.layer)
    row, col = (
        int((v - o) / last.resolution) for v, o in zip(at[::-1], last.origin[::-1], strict=True)
    )
    inside = np.isfinite(last.maps.get('nominal', last.z))
    edge = (
        float(distance_transform_edt(inside)[row, col]) * last.resolution
        if not inside.all()
        else math.inf
    )
    if edge < near:
        found.append(f'free side, {edge * 1e3:.1f} mm away')
    for a in job.run.get('anomalies') or []:
        if (
            isinstance(a, dict)
            and a.get('layer') == last.layer
            and a.get('class') in ('arc', 'wire', 'feed', 'gas')
        ):
            x, y = _xy(a.get('position'))
            if math.hypot(x - at[0], y - at[1]) < near:
                found.append(str(a.get('text')))
    return found


def _xy(place: object) -> tuple[float, float]:
    if not isinstance(place, list | tuple) or len(place) < 2:
        return math.nan, math.nan
    return number(place[0]), number(place[1])


def _too_hot(job: Job, layer: int) -> list[str]:
    """Of the part when the layer began."""
    limit = interpass_limit(job)
    for record in job.layers:
        if (
            record.get('layer') == layer
            and not record.get('final')
            and number(record.get('temperature')) > limit
        ):
            told = f'{number(record.get("temperature")):.0f} °C, interpass limit {limit:.0f} °C'
            return [f'temperature: the layer began at {told}']
    return []


def _unseen(before: Scan, around: np.ndarray) -> list[str]:
    blind = ~np.isfinite(before.z[around]) | (
        before.maps.get('count', np.ones(before.z.shape))[around] == 0
    )
    if blind.size and blind.mean() > UNSEEN:
        return [f'not seen by the scanner after layer {before.layer}']
    return []
