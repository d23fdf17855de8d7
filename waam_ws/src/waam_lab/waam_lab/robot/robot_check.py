"""A plan on the robot before the arc: reach, contacts, and where the torch will not have the programmed speed."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from waam_node.params import ParameterError
from waam_plan.plan import Plan, PlannedLayer
from waam_process.segment import Kind, Segment
from waam_robot.bend import Bend, bend
from waam_robot.collision import CollisionError, Scene
from waam_robot.joint_path import Machine
from waam_robot.station import JOINTS, Station, StationError
from waam_robot.timing import AXIS_NAMES
from waam_robot_bridge.foresee import END, START, TOLD, Place, asked, places
from waam_robot_bridge.params import RobotParams

from .dry_run import DryRunError, layers, work_zero

STEP = 1e-3  # m between the places of the torch that are looked at
MOST_LINES = 20
MAPPED = 400  # places of a map that are looked at


@dataclass(frozen=True)
class RobotCheck:
    """length: m with the arc on. ends: m at starts and ends together, and the longest of them; off: places between
    them; contacts: one line each; problem: why the plan cannot be run at all; unchecked: why contacts were not looked
    for; bend: of the maps that the scanner will measure."""

    length: float
    ends: tuple[float, float] = (0.0, 0.0)
    off: tuple[Place, ...] = ()
    contacts: tuple[str, ...] = ()
    problem: str = ''
    unchecked: str = ''
    bend: Bend | None = None
    used: np.ndarray | None = None

    @property
    def refused(self) -> str:
        """Why the plan must not be run on the robot; '' = it may."""
        stopping = next((p.text for p in self.off if p.stops), '')
        return self.problem or next(iter(self.contacts), '') or stopping

    def lines(self) -> list[str]:
        """What people are told."""
        if self.problem:
            return [f'robot: {self.problem}']
        share = 1 - (self.ends[0] + sum(p.end - p.begin for p in self.off)) / max(self.length, 1e-9)
        out = [
            f'robot: the torch has the programmed speed within {TOLD:.0%} on {share:.2%} of {self.length:.2f} m; '
            f'starts and ends take {self.ends[1] * 1e3:.1f} mm at most'
        ]
        out += _some([f'  {p.text}' for p in self.off], 'places')
        if self.used is not None:
            out.append(f'robot: {_drives(self.used)}')
        out += _some([f'contact: {text}' for text in self.contacts], 'contacts')
        if self.bend:
            out.append(f'robot: {self.bend.text}')
        if self.unchecked:
            out.append(f'warning: contacts were not looked for: {self.unchecked}')
        elif not self.contacts:
            out.append(
                'robot: arm, torch, part and positioner keep their distance, ways between beads included'
            )
        return out


def check(
    plan: Plan, params: RobotParams, told: Callable[[int], None] = lambda layer: None
) -> RobotCheck:
    """The plan, with its reach as that of the machine, on the robot of the parameters. `told` after every layer."""
    length = sum(layer.length for layer in plan.layers)
    stands = float(np.degrees(params.tilt))
    if abs(stands - plan.settings.tilt_deg) > 1e-3:
        text = f'the plan is for a tilt of {plan.settings.tilt_deg:g} deg, the positioner stands at {stands:g}'
        return RobotCheck(length, problem=text)
    found: list[Place] = []
    used = np.zeros((3, JOINTS))
    try:
        station = Station(params.place())
        for laid in layers(plan, params, told, station):
            found += [p for bead in laid.beads for p in places(bead, station, params)]
            drives = asked(laid.tips, station, params)
            used = np.maximum(used, drives.most)
            said = drives.too_much(laid.tips, work_zero(plan, station))
            if said and not any(p.stops for p in found):
                return RobotCheck(length, problem=f'layer {laid.number}, {said}')
        contacts, unchecked = _contacts(plan, station)
    except (StationError, DryRunError, ParameterError) as e:
        return RobotCheck(length, problem=str(e))
    ends = [p.end - p.begin for p in found if p.cause in (START, END)]
    off = tuple(p for p in found if p.cause not in (START, END))
    longest = (sum(ends), max(ends, default=0.0))
    bent = _bend(plan, station, params)
    return RobotCheck(
        length, longest, off, tuple(contacts), unchecked=unchecked, bend=bent, used=used
    )


def _some(lines: list[str], what: str) -> list[str]:
    rest = len(lines) - MOST_LINES
    return lines[:MOST_LINES] + ([f'  ... and {rest} more {what}'] if rest > 0 else [])


def _drives(used: np.ndarray) -> str:
    """How much of their limits the joints use."""
    shares = [
        f'{row.max():.0%} of the {what} ({AXIS_NAMES[int(row.argmax())]})'
        for what, row in zip(('speed', 'acceleration', 'jerk'), used, strict=True)
    ]
    return f'its joints use at most {shares[0]}, {shares[1]} and {shares[2]} that they may have'


def _bend(plan: Plan, station: Station, params: RobotParams) -> Bend | None:
    """Of the map of all that is laid, the work zero being where the robot was taught."""
    laid = np.any([layer.footprint for layer in plan.layers], axis=0)
    rows, columns = np.nonzero(laid)
    if not len(rows):
        return None
    some = np.linspace(0, len(rows) - 1, min(len(rows), MAPPED)).astype(int)
    x, y = plan.spec.x[columns[some]], plan.spec.y[rows[some]]
    zero = np.array(work_zero(plan, station))
    tips = np.column_stack([x, y, np.full(len(x), plan.settings.clearance)]) + zero
    beside = np.array([plan.settings.scanner_offset[0], plan.settings.scanner_offset[1], 0.0])
    return bend(station, tips, zero, beside, params.stated())


# ---- contacts


def _contacts(plan: Plan, station: Station) -> tuple[list[str], str]:
    """One line for every way that touches something, and why none was looked at."""
    place = station.place
    try:
        scene = Scene(Machine(place.arm, place.positioner), held=station.held)
    except CollisionError as e:
        return [], str(e)
    zero = np.array(work_zero(plan, station))
    shift = zero + place.origin
    bottom = np.inf if place.tilt else 0.0  # a tilted part does not reach down to a level faceplate
    top, found = plan.as_found.z.copy(), []
    here: np.ndarray | None = None
    for layer in plan.layers:
        np.copyto(top, layer.target_after, where=layer.footprint)
        corner = (plan.spec.origin_x + shift[0], plan.spec.origin_y + shift[1])
        scene.set_surface(corner, plan.spec.resolution, top + shift[2], bottom)
        for name, way in _ways(layer, here):
            joints = station.joints(way + zero)
            contact = scene.first(joints)
            if contact is not None:
                gone = np.linalg.norm(np.diff(way[: contact.at + 1], axis=0), axis=1).sum()
                x, y, z = (contact.tip - shift) * 1e3
                found.append(
                    f'layer {layer.number}, {name}, {gone * 1e3:.1f} mm from its start, '
                    f'at ({x:.1f}, {y:.1f}, {z:.1f}) mm: {contact.text}'
                )
            here = way[-1]
    return found, ''


def _ways(layer: PlannedLayer, here: np.ndarray | None) -> Iterator[tuple[str, np.ndarray]]:
    """Name and places (n, 3) m, work frame, of every bead and every way to a bead."""
    for (kind, bead), group in groupby(layer.segments, key=_which):
        points = [s for s in group if s.kind != Kind.DWELL]
        if not points:
            continue
        corners = np.array([points[0].start, *(s.end for s in points)])
        if here is not None and np.abs(corners[0] - here).max() > STEP:
            yield 'the way from the layer before', _even(np.array([here, corners[0]]))
        yield (f'bead {bead}' if kind == Kind.DEPOSIT else 'a way with the arc off'), _even(corners)
        here = corners[-1]


def _which(segment: Segment) -> tuple[Kind, int]:
    kind = Kind.DEPOSIT if segment.arc else Kind.IDLE
    return kind, segment.bead if segment.arc else 0


def _even(corners: np.ndarray) -> np.ndarray:
    """(n, 3): corners and places between them, STEP apart at most."""
    lengths = np.linalg.norm(np.diff(corners, axis=0), axis=1)
    counts = np.maximum(np.ceil(lengths / STEP), 1).astype(int)
    pieces = [
        a + np.arange(n)[:, None] / n * (b - a)
        for a, b, n in zip(corners, corners[1:], counts, strict=False)
    ]
    return np.concatenate([*pieces, corners[-1:]])
