"""Where the torch will not have the programmed speed, told before the arc. Pure.

The controller core says where it will have the torch in every millisecond of a bead. What the robot makes of it is
known too: corners become curves (`blend`), the rest stays. So the speed at the part is known before metal is laid, and
so are speed, acceleration and jerk of each joint. A joint that would have to do more than it can stops the job there.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from waam_robot.bead import at_ways, make_bead, way_along
from waam_robot.station import Reach
from waam_robot.timing import SHARE, TimingError, time_bead

from .blend import MAX_TURN, MIN_TURN, blended
from .limits import Limits, smoothing
from .params import RobotParams

SPEED_TOLERANCE = 0.01  # share of the programmed speed from which a difference is told
WINDOW = 50  # ms over which the speed is measured
EVERY = 5  # ms between the joints that are looked at
SHARP = np.radians(45.0)  # a corner that counts more than a change of speed beside it
STRAIGHT = np.cos(np.radians(1.0))  # pieces of a leg turn by less
GAP = 0.5e-3  # m: places nearer to each other are one
FULL = 0.98  # of SHARE, from which on a joint is taken to hold the torch up
CAUSE_RADIUS = 2.0e-3  # m to both sides in which the cause of a place is looked for
CAUSES = START, END, STEP = ('start', 'end', 'the programmed speed changes')


@dataclass(frozen=True)
class Bead:
    """A stretch from arc on to arc off. corners: (m, 3) m, the programmed path in machine coordinates; speeds: (m - 1,)
    m/s of its pieces; tips: (n, 3) m, where the core has the torch in every ms; numbers: (m - 1,) int, beads that the
    pieces belong to; layer: as the plan counts it; work_zero: (3,) m."""

    corners: np.ndarray
    speeds: np.ndarray
    tips: np.ndarray
    numbers: np.ndarray
    layer: int = 0
    work_zero: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Place:
    """A stretch of a bead that is laid too slowly or too fast. begin, end: m from the bead's start; speed, wanted: m/s
    where the difference is largest; cause: what holds it up; at: (3,) m, work frame, there; stops: the job would end
    there; possible: m/s, what the drives allow there, NaN = nobody computed it."""

    layer: int
    bead: int
    begin: float
    end: float
    speed: float
    wanted: float
    cause: str
    at: np.ndarray
    stops: bool = False
    possible: float = float('nan')

    @property
    def text(self) -> str:
        """One line for people."""
        x, y, z = self.at * 1e3
        said = (
            f'layer {self.layer}, bead {self.bead}, {self.begin * 1e3:.1f} to {self.end * 1e3:.1f} mm from its start, '
            f'at ({x:.1f}, {y:.1f}, {z:.1f}) mm: '
        )
        if self.stops:
            slower = f'; {self.possible * 1e3:.2f} mm/s is possible' if self.possible > 0 else ''
            return f'{said}{self.cause}: the job would be held there{slower}'
        return f'{said}{self.speed * 1e3:.2f} mm/s instead of {self.wanted * 1e3:.2f}: {self.cause}'


@dataclass(frozen=True)
class Asked:
    """shares: (k, 3, n) of the limits of speed, acceleration and jerk, every EVERY ms."""

    shares: np.ndarray
    limits: Limits

    def text(self, n: int) -> str:
        """What is asked most of the drives at the n-th place."""
        kind, axis = np.unravel_index(int(self.shares[n].argmax()), self.shares[n].shape)
        return self.limits.text(int(kind), int(axis), float(self.shares[n, kind, axis]))

    @property
    def most(self) -> np.ndarray:
        """(3, n) largest shares."""
        return np.asarray(self.shares.max(axis=0))

    def too_much(self, tips: np.ndarray, work_zero: tuple[float, float, float]) -> str:
        """Where on the way (n, 3) m that was asked for a drive is too weak first; '' = nowhere."""
        over = self.shares.max(axis=(1, 2)) > 1
        if not over.any():
            return ''
        n = int(np.argmax(over))
        x, y, z = (tips[n * EVERY] - work_zero) * 1e3
        return f'at ({x:.1f}, {y:.1f}, {z:.1f}) mm: {self.text(n)}: the job would be held there'


def asked(tips: np.ndarray, station: Reach, params: RobotParams) -> Asked:
    """Of the drives by the way (n, 3) m, every ms, as the core commands it. StationError where the arm does not
    reach."""
    limits = params.limits_of_joints()
    path = blended(tips, params.corner, smoothing(station.gains, limits))
    return _asked(path, station, limits)


def _asked(path: np.ndarray, station: Reach, limits: Limits) -> Asked:
    """Of a path of the robot."""
    if len(path) < 4 * EVERY:
        return Asked(np.zeros((max(len(path), 1), 3, len(limits.names))), limits)
    return Asked(limits.shares(station.joints(path[::EVERY]), EVERY * 1e-3), limits)


def places(bead: Bead, station: Reach, params: RobotParams) -> list[Place]:
    """Where the speed at the part is off by more than SPEED_TOLERANCE, and where a drive is too weak for it, in order.

    StationError where the arm does not reach.
    """
    if len(bead.tips) < 2 * WINDOW:
        return []
    trace = _trace(bead, station, params)
    possible = _possible(bead, station, params) if (trace.used > 1).any() else None
    off = np.abs(trace.speed / trace.wanted - 1)
    moving = (trace.way > 1e-6) & (trace.way < trace.given[-1] - 1e-6)
    wrong = ((off > SPEED_TOLERANCE) | (trace.used > 1)) & moving
    found = [_place(trace, off, a, b) for a, b in _stretches(wrong, trace.way)]
    return found if possible is None else [_slowed(p, bead, possible) for p in found]


def _possible(
    bead: Bead, station: Reach, params: RobotParams
) -> tuple[np.ndarray, np.ndarray] | None:
    """((k, 3) m, machine coordinates, (k,) m/s): along the bead but its ends, what TOPPRA finds possible with these
    drives up to the programmed speed; None without toppra, or where it finds nothing."""
    path = make_bead(bead.corners, corner=params.corner)
    try:
        timed = time_bead(
            path, station.joints(path.points), float(bead.speeds.max()), params.limits_of_joints()
        )
    except TimingError:
        return None
    moving = (timed.way > CAUSE_RADIUS / 2) & (timed.way < path.length - CAUSE_RADIUS / 2)
    return at_ways(path.way, path.points, timed.way[moving]), timed.speed[moving]


def _slowed(place: Place, bead: Bead, possible: tuple[np.ndarray, np.ndarray]) -> Place:
    """The place with the least speed that is possible near it."""
    points, speed = possible
    near = np.linalg.norm(points - bead.work_zero - place.at, axis=1) < CAUSE_RADIUS
    if not place.stops or not near.any():
        return place
    return replace(place, possible=float(speed[near].min()))


@dataclass(frozen=True)
class _Trace:
    """Every ms but the first and last of the window: tips (k, 3) m of the robot, way (k,) m along the bead, piece (k,),
    speed, wanted (k,) m/s, used (k,) largest share of a joint's speed and axis (k,), which joint; given (m,) m: the
    way to every corner."""

    bead: Bead
    given: np.ndarray
    tips: np.ndarray
    way: np.ndarray
    piece: np.ndarray
    speed: np.ndarray
    wanted: np.ndarray
    used: np.ndarray
    drives: Asked
    near: np.ndarray

    def slowed(self, a: int, b: int) -> str:
        """Which drive is too weak for the programmed speed from the a-th to before the b-th ms, where the torch was
        slowed down for it; '' = none."""
        some = self.drives.shares[self.near[a:b], 0]
        wanted = some * (self.wanted[a:b] / np.maximum(self.speed[a:b], 1e-9))[:, None]
        held = np.where(some > FULL * SHARE, wanted, 0.0)
        axis = int(held.max(axis=0).argmax())
        most = float(held[:, axis].max())
        return self.drives.limits.text(0, axis, most) if most > SHARE else ''


def _trace(bead: Bead, station: Reach, params: RobotParams) -> _Trace:
    limits = params.limits_of_joints()
    path = blended(bead.tips, params.corner, smoothing(station.gains, limits))
    half = WINDOW // 2
    at = np.arange(half, len(path) - half)
    way, gone, given = (way_along(points) for points in (bead.tips, path, bead.corners))
    piece = np.searchsorted(given, way[at], 'right') - 1
    piece = np.clip(piece, 0, len(bead.speeds) - 1)
    speed = (gone[at + half] - gone[at - half]) / (WINDOW * 1e-3)
    drives = _asked(path, station, limits)
    near = np.minimum((at + EVERY // 2) // EVERY, len(drives.shares) - 1)
    return _Trace(
        bead=bead,
        given=given,
        tips=path[at],
        way=way[at],
        piece=piece,
        speed=speed,
        wanted=bead.speeds[piece],
        used=drives.shares.max(axis=(1, 2))[near],
        drives=drives,
        near=near,
    )


def _place(trace: _Trace, off: np.ndarray, a: int, b: int) -> Place:
    """The stretch from the a-th to before the b-th ms; off: (k,) share of the programmed speed."""
    bead, stops = trace.bead, bool(trace.used[a:b].max() > 1)
    worst = a + int(np.argmax((trace.used if stops else off)[a:b]))
    begin, end = float(trace.way[a]), float(trace.way[b - 1])
    cause = (
        trace.drives.text(int(trace.near[worst]))
        if stops
        else trace.slowed(a, b) or _cause(bead, trace.given, begin, end)
    )
    number = int(bead.numbers[trace.piece[a]])
    since = float(trace.given[np.argmax(bead.numbers == number)])
    return Place(
        layer=bead.layer,
        bead=number,
        begin=begin - since,
        end=end - since,
        speed=float(trace.speed[worst]),
        wanted=float(trace.wanted[worst]),
        cause=cause,
        at=trace.tips[worst] - bead.work_zero,
        stops=stops,
    )


def _lengths(points: np.ndarray) -> np.ndarray:
    return np.asarray(np.linalg.norm(np.diff(points, axis=0), axis=1))


def _stretches(wrong: np.ndarray, way: np.ndarray) -> Iterator[tuple[int, int]]:
    """(first, behind the last) of the runs of `wrong`; runs nearer than GAP to each other are one."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], wrong, [0]])))
    runs = edges.reshape(-1, 2).tolist()
    while runs:
        a, b = runs.pop(0)
        while runs and way[runs[0][0]] - way[b - 1] < GAP:
            b = runs.pop(0)[1]
        yield a, b


def _cause(bead: Bead, given: np.ndarray, begin: float, end: float) -> str:
    """What the path has there."""
    if begin < CAUSE_RADIUS:
        return START
    if end > given[-1] - CAUSE_RADIUS:
        return END
    inner = np.flatnonzero(
        (given[1:-1] > begin - CAUSE_RADIUS) & (given[1:-1] < end + CAUSE_RADIUS)
    )
    ways = np.diff(bead.corners, axis=0) / np.maximum(_lengths(bead.corners), 1e-12)[:, None]
    turns = np.arccos(np.clip(np.einsum('ij,ij->i', ways[:-1], ways[1:]), -1, 1))
    turn = float(turns[inner].max(initial=0.0))
    changes = len(inner) and np.ptp(bead.speeds[[*inner, inner[-1] + 1]]) > 0
    if turn > MIN_TURN and not (changes and turn < SHARP):
        return _corner(bead, int(inner[np.argmax(turns[inner])]), turn, ways)
    if changes:
        return STEP
    return 'bends of the path'


def _corner(bead: Bead, n: int, turn: float, ways: np.ndarray) -> str:
    """Why the robot takes no curve between the pieces n and n + 1."""
    said = f'a corner of {np.degrees(turn):.0f} deg'
    leg = _leg(bead, n, ways)
    if turn > MAX_TURN:
        return f'{said}: curves turn by {np.degrees(MAX_TURN):.0f} deg at most'
    if np.abs(ways[n : n + 2, 2]).max() > 1e-3:
        return f'{said} that climbs'
    if leg < 2 * CAUSE_RADIUS:
        return f'{said} beside a leg of {leg * 1e3:.1f} mm, too short for a curve'
    return f'{said} into which no curve fits'


def _leg(bead: Bead, n: int, ways: np.ndarray) -> float:
    """m: the shorter one of the straight legs before and behind the corner at the end of piece n."""
    lengths = _lengths(bead.corners)
    before, behind = lengths[n::-1], lengths[n + 1 :]
    bent_before = np.flatnonzero(ways[n::-1] @ ways[n] < STRAIGHT)
    bent_behind = np.flatnonzero(ways[n + 1 :] @ ways[n + 1] < STRAIGHT)
    legs = [
        leg[: bent[0]] if len(bent) else leg
        for leg, bent in ((before, bent_before), (behind, bent_behind))
    ]
    return float(min(leg.sum() for leg in legs))
