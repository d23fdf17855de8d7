"""Maps from recordings of a robot and a line laser whose clocks and mounting nobody wrote down.

Laser files hold lateral position and distance with millisecond stamps of one computer, the robot's log positions with
stamps truncated to 0.1 s of another. What is needed to bring them together is found in the data themselves:

* when the robot was where: a scan is a straight motion at constant speed, so time is a linear function of position,
  and every truncated stamp confines it to a window 0.1 s wide; dozens of windows leave a few milliseconds;
* the lag between the clocks: at the end of a scan the robot lifts the scanner, both logs see the ramp;
* the substrate: the plane that most points lie on; heights are counted along its normal;
* where the scanner sits beside the torch: the bead that appears between first and last scan was laid at known places.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from waam_process.grid import GridSpec

from ..fusion.height_map import FusedMap, Fusion
from ..fusion.limits import FusionLimits
from ..stream.assembler import Assembler, ProfileBlock
from ..stream.poses import PoseStatus, PoseTrack
from ..transform import Mounting, rotation_rpy
from .bead import WallError, find_bead
from .files import HOUR, ArcLog, LaserScan

MAX_POSE_GAP_NS = 250_000_000  # at steady speed; the log leaves out a line now and then
BELOW, ABOVE = -5e-3, 60e-3  # m, heights beside the substrate that are kept


@dataclass(frozen=True)
class ScanMotion:
    """A straight motion along x at constant height."""

    rows: np.ndarray  # (n,) of the arc log
    t: np.ndarray  # (n,) s, restored times of these rows
    speed: float  # m/s, signed
    slack: float  # s, width of the window that the truncated stamps leave for the time


def restore_times(
    stamps: np.ndarray, x: np.ndarray, speed: float, quantum: float
) -> tuple[np.ndarray, float]:
    """Times (n,) s of a motion x (n,) m at constant signed speed (m/s) whose stamps were truncated to `quantum` (s).

    t = c + x / speed must satisfy stamp <= t < stamp + quantum in every row; c is the middle of what all rows allow.
    Also returns the slack: how much c could still move (s). Negative slack: the speed is not that steady.
    """
    rest = stamps - x / speed
    c = 0.5 * (rest.max() + rest.min() + quantum)
    return c + x / speed, quantum - float(np.ptp(rest))


def find_scans(log: ArcLog, min_length: float = 0.05, level: float = 0.2e-3) -> list[ScanMotion]:
    """The scans in an arc log: arc off, one way along x over at least `min_length` (m), z within `level` (m)."""
    x, z = log.position[:, 0], log.position[:, 2]
    good = (np.abs(np.diff(x, prepend=x[0])) > 0.5e-3) & ~log.arc
    good &= np.abs(np.diff(z, prepend=z[0])) < level
    edges = np.flatnonzero(np.diff(good.astype(int), prepend=0, append=0))
    found = []
    for start, end in zip(edges[::2], edges[1::2], strict=True):
        rows = np.arange(start, end)[1:-1]  # the robot blends into and out of the motion
        rows = rows[np.abs(z[rows] - np.median(z[rows])) < level] if len(rows) else rows
        if len(rows) >= 10 and np.ptp(x[rows]) >= min_length and _one_way(x[rows]):
            found.append(rows)
    if not found:
        return []
    speed = float(np.mean(log.speed[np.concatenate(found)]))  # all scans are programmed alike
    return [_motion(log, rows, speed) for rows in found]


def _one_way(x: np.ndarray) -> bool:
    return bool((np.diff(x) * np.sign(x[-1] - x[0]) > 0).all())


def _motion(log: ArcLog, rows: np.ndarray, speed: float) -> ScanMotion:
    x = log.position[rows, 0]
    signed = float(np.copysign(speed, x[-1] - x[0]))
    t, slack = restore_times(log.t[rows], x, signed, log.quantum)
    return ScanMotion(rows, t, signed, slack)


def hour_seconds(stamps: np.ndarray) -> np.ndarray:
    """Seconds since the beginning of the hour of the first stamp (n,) int64 ns."""
    start = stamps[0] // int(HOUR * 1e9) * int(HOUR * 1e9)
    return (stamps - start) * 1e-9


def lift_time(t: np.ndarray, height: np.ndarray, levels: np.ndarray) -> np.ndarray:
    """Times (s) at which a rising ramp passes levels above its start (m)."""
    return np.interp(levels, np.maximum.accumulate(height), t)


def clock_lag(laser: LaserScan, log: ArcLog, motion: ScanMotion) -> float:
    """Seconds to add to laser times so that they become times of the arc log, from the lift at the end of the scan."""
    distance = np.nanmedian(laser.range, axis=1)
    level = np.median(distance)
    last = np.flatnonzero(np.abs(distance - level) < 0.5e-3)
    if len(last) == 0 or last[-1] > len(distance) - 4 or distance[-1] - level < 8e-3:
        raise WallError('the profiles do not show the scanner being lifted at the end of the scan')
    ramp = np.arange(last[-1] - 1, len(distance))
    end = motion.rows[-1]
    rows = np.arange(end, min(end + 12, len(log.t)))
    period = float(np.median(np.diff(motion.t)))
    t_robot = motion.t[-1] + period * np.arange(len(rows))
    rise = log.position[rows, 2] - log.position[end, 2]
    levels = np.linspace(3e-3, min(9e-3, float(rise.max())), 7)
    seen = lift_time(hour_seconds(laser.stamps)[ramp], distance[ramp] - level, levels)
    return float(np.median(lift_time(t_robot, rise, levels) - seen))


@dataclass(frozen=True)
class Plane:
    """z = a + b x + c y (m); scatter: robust standard deviation of its points (m)."""

    a: float
    b: float
    c: float
    scatter: float

    @property
    def rotation(self) -> np.ndarray:
        """(3, 3), turns the plane's normal to +z."""
        return rotation_rpy(-np.arctan(self.c), np.arctan(self.b), 0.0)


def fit_substrate(points: np.ndarray) -> Plane:
    """The plane that most points (n, 3) lie on: from those near the commonest height, then clipped least squares."""
    z = points[:, 2]
    counts, edges = np.histogram(z, bins=np.arange(z.min(), z.max() + 1e-3, 0.5e-3))
    mode = edges[np.argmax(np.convolve(counts, np.ones(4), 'same'))]
    use = np.abs(z - mode) < 1.5e-3
    design = np.column_stack([np.ones(len(points)), points[:, :2]])
    for _ in range(12):
        p = np.linalg.lstsq(design[use], z[use], rcond=None)[0]
        residual = z - design @ p
        scatter = 1.4826 * float(np.median(np.abs(residual[use])))
        use = np.abs(residual) < 3.0 * scatter
    return Plane(float(p[0]), float(p[1]), float(p[2]), scatter)


@dataclass(frozen=True)
class RecordedScan:
    """A laser file with poses."""

    laser: LaserScan  # its profiles
    motion: ScanMotion  # of the robot during the scan
    track: PoseTrack  # positions of the torch
    stamps: np.ndarray  # (n,) ns of the profiles, by the clock of the robot
    plane: Plane  # substrate in robot axes
    lag: float  # s, of the clock of the laser file


# The scanner looks down: distance grows downwards, and its lateral axis lies across the travel.
# Which side is + cannot be told from one wall; + lateral is taken as + y.
ACROSS = rotation_rpy(0.0, 0.0, np.pi / 2)


def prepare(laser: LaserScan, log: ArcLog, motion: ScanMotion, lag: float) -> RecordedScan:
    """Poses and substrate of one scan."""
    track = PoseTrack(len(motion.rows) + 1)
    for t, p in sorted(zip(motion.t, log.position[motion.rows], strict=True), key=lambda tp: tp[0]):
        track.append(round(float(t) * 1e9), *map(float, p))
    stamps = np.round((hour_seconds(laser.stamps) + lag) * 1e9).astype(np.int64)
    tcp, status = track.at(stamps, MAX_POSE_GAP_NS)
    ok = status == PoseStatus.OK
    if ok.sum() < 10:
        raise WallError(f'only {ok.sum()} profiles fall into the scanning motion of the robot')
    points = Mounting(np.zeros(3), ACROSS).points(tcp[ok], laser.x[ok], -laser.range[ok])
    points = points[np.isfinite(points).all(axis=-1)]
    return RecordedScan(laser, motion, track, stamps, fit_substrate(points), lag)


def place(scan: RecordedScan, shift: tuple[float, float]) -> tuple[PoseTrack, Mounting]:
    """Poses and mounting of a scan in levelled axes: z along the normal of the substrate, zero on it.

    shift: (x, y) m of the scanner against the torch.
    """
    level = scan.plane.rotation
    zero = np.array([0.0, 0.0, scan.plane.a])
    track = PoseTrack(len(scan.track) + 1)
    for t, p in zip(scan.track.stamps, scan.track.positions, strict=True):
        track.append(int(t), *map(float, level @ (p - zero)))
    return track, Mounting(np.array([*shift, 0.0]), level @ ACROSS)


def fuse(
    scan: RecordedScan, spec: GridSpec, shift: tuple[float, float]
) -> tuple[FusedMap, Assembler]:
    """Heights above the substrate on `spec`."""
    track, mounting = place(scan, shift)
    limits = FusionLimits(height_min=BELOW, height_max=ABOVE)
    assembler = Assembler(Fusion(spec, mounting, limits), track, MAX_POSE_GAP_NS)
    x, z = (a.astype(np.float32) for a in (scan.laser.x, -scan.laser.range))
    assembler.add(ProfileBlock(scan.stamps, x, z))
    assembler.close()
    return assembler.fusion.result(), assembler


def profile_points(scan: RecordedScan, shift: tuple[float, float]) -> np.ndarray:
    """(n, m, 3) m, the points of all profiles that have a pose, in the axes of the map."""
    track, mounting = place(scan, shift)
    tcp, status = track.at(scan.stamps, MAX_POSE_GAP_NS)
    ok = status == PoseStatus.OK
    return mounting.points(tcp[ok], scan.laser.x[ok], -scan.laser.range[ok])


def grid_of(scans: list[RecordedScan], cell: float, shift: tuple[float, float]) -> GridSpec:
    """A grid for all scans: over the motion along x, over the field of view along y."""
    x = np.concatenate([s.track.positions[:, 0] for s in scans]) + shift[0]
    y = np.concatenate([s.track.positions[:, 1] for s in scans]) + shift[1]
    lateral = scans[0].laser.x[np.isfinite(scans[0].laser.x)]
    low, high = np.percentile(lateral, [1, 99])

    def down(v: float) -> float:
        return float(np.floor(v / cell) * cell)

    return GridSpec.covering(
        down(x.min()), down(y.min() + low), float(x.max()), float(y.max() + high), cell
    )


def weld_line(log: ArcLog) -> tuple[float, float, float]:
    """Smallest and largest x and the median y (m) of the torch while the arc was on."""
    if not log.arc.any():
        raise WallError('the arc was never on in the arc log')
    p = log.position[log.arc]
    return float(p[:, 0].min()), float(p[:, 0].max()), float(np.median(p[:, 1]))


def scanner_shift(scans: list[RecordedScan], log: ArcLog, cell: float) -> tuple[float, float]:
    """(x, y) m of the scanner against the torch: puts the middle of the bead where the arc was."""
    spec = grid_of(scans, cell, (0.0, 0.0))
    bead = find_bead(fuse(scans[0], spec, (0.0, 0.0))[0], fuse(scans[-1], spec, (0.0, 0.0))[0])
    x_min, x_max, y = weld_line(log)
    return 0.5 * (x_min + x_max) - 0.5 * (bead.start + bead.end), y - bead.axis
