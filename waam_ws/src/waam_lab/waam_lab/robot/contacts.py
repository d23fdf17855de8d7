"""Contacts along all ways of a plan: arm, torch, positioner and the part as it grows."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from waam_plan.plan import Plan, PlannedLayer
from waam_process.segment import Kind, Segment
from waam_robot.collision import CollisionError, Scene
from waam_robot.positioner import Machine
from waam_robot.station import Reach, Station, evenly
from waam_robot.urdf_bodies import UrdfCell
from waam_robot.urdf_station import UrdfStation
from waam_robot.urdf_text import UrdfError

from .dry_run import work_zero

STEP = 1e-3  # m between the places of the torch that are looked at


@dataclass(frozen=True)
class Contacts:
    """found: one line for every way that touches something; unchecked: why none was looked at; left_out: links that
    were not looked at, because their shapes are meshes."""

    found: tuple[str, ...] = ()
    unchecked: str = ''
    left_out: tuple[str, ...] = ()


def contacts(plan: Plan, station: Reach) -> Contacts:
    """Of all ways of the plan, those between layers too. StationError where the arm does not reach."""
    try:
        scene, origin, left_out = _scene(station)
    except (CollisionError, UrdfError) as e:
        return Contacts(unchecked=str(e))
    zero = np.array(work_zero(plan, station))
    shift = zero + origin
    # a tilted part does not reach down to a level faceplate
    bottom = np.inf if plan.settings.tilt_deg else 0.0
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
    return Contacts(tuple(found), left_out=left_out)


def _scene(station: Reach) -> tuple[Scene, tuple[float, float, float], tuple[str, ...]]:
    """(scene, machine zero in the frame of the part, links that are left out)."""
    if isinstance(station, Station):
        place = station.place
        machine = Machine(place.arm, place.positioner)
        return Scene(machine, held=station.held), place.origin, ()
    if not isinstance(station, UrdfStation):
        raise CollisionError('nobody knows the bodies of this arm')
    posture = station.joints(np.add(station.place.low, station.place.high)[None] / 2)[0]
    cell = UrdfCell(station.text, station.place.joint_names, posture)
    scene = Scene(Machine(), cell.bodies, frames=cell.frames)
    return scene, station.place.origin, cell.left_out


def _ways(layer: PlannedLayer, here: np.ndarray | None) -> Iterator[tuple[str, np.ndarray]]:
    """Name and places (n, 3) m, work frame, of every bead and every way to a bead."""
    for (kind, bead), group in groupby(layer.segments, key=_which):
        points = [s for s in group if s.kind != Kind.DWELL]
        if not points:
            continue
        corners = np.array([points[0].start, *(s.end for s in points)])
        if here is not None and np.abs(corners[0] - here).max() > STEP:
            yield 'the way from the layer before', evenly(np.array([here, corners[0]]), STEP)
        yield (
            (f'bead {bead}' if kind == Kind.DEPOSIT else 'a way with the arc off'),
            evenly(corners, STEP),
        )
        here = corners[-1]


def _which(segment: Segment) -> tuple[Kind, int]:
    kind = Kind.DEPOSIT if segment.arc else Kind.IDLE
    return kind, segment.bead if segment.arc else 0
