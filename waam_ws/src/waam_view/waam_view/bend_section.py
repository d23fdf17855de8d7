"""How the positioner of a robot held the part, and by how much pose errors have bent the last map of a job, for its
report; nothing for a gantry."""

from __future__ import annotations

from html import escape
from typing import Any

import numpy as np

from waam_robot.bend_fit import BendFit, FitError, Surface, fit
from waam_robot.known_surface import known_cells
from waam_robot.positioner import Positioner
from waam_robot.station import Place, Station
from waam_robot.turning import Turning
from waam_robot.uncertain import Stated

from .job_data import Job, Scan, find_value

PLACES = 400  # of the map that are told about
HEIGHT = 0.03  # m of the torch over the part in a scan, about


def bend_section(job: Job) -> str:
    """HTML; '' for a job that was not laid by a robot."""
    nodes = job.asked.get('nodes') or {}
    bridge = next((v for v in nodes.values() if isinstance(v, dict) and 'joint_offset' in v), None)
    if bridge is None or not job.scans:
        return ''
    try:
        said = bend_of(job.scans[-1], bridge, job.asked).text
    except (FitError, ValueError, TypeError, KeyError) as e:
        said = f'not estimated: {e}'
    held = f'<h2>Positioner</h2><p>{escape(_held(bridge))}</p>'
    return f'{held}<h2>Bend of the map</h2><p>{escape(said)}</p>'


def _held(bridge: dict[str, Any]) -> str:
    """How the positioner held the part, by the parameters of the bridge."""
    turning, tilt = _turning(bridge), float(bridge.get('tilt') or 0.0)
    if not turning.still:
        return (
            f'It turned the level part while the torch went: by {turning.text} from the middle of the box, beside '
            'where it stands at rest.'
        )
    if tilt:
        return f'It held the part still, tilted by {np.degrees(tilt):.1f} deg towards the robot.'
    return 'It held the part still and level.'


def _turning(bridge: dict[str, Any]) -> Turning:
    start, x, y = map(float, bridge.get('turning') or (0.0, 0.0, 0.0))
    return Turning(start, (x, y))


def bend_of(scan: Scan, bridge: dict[str, Any], asked: dict[str, Any]) -> BendFit:
    """Of a scan by a robot with the parameters `bridge`; asked: job.yaml. FitError where nothing is known beside the
    place that was restored, and for an arm from a URDF."""
    if bridge.get('urdf'):
        raise FitError('only the M-20iB/25 is looked at, not an arm from a URDF')
    zero = np.array(find_value(asked, 'work_offset') or (0.0, 0.0, 0.0), float)
    mount = find_value(asked, 'mount_xyz') or (0.060, 0.0, 0.120)
    scanner = np.array([float(mount[0]), float(mount[1]), -HEIGHT])
    stated = Stated(*(float(bridge[k]) for k in ('joint_offset', 'gear_wave', 'link_length')))
    return fit(_station(bridge), _surface(scan, zero), zero, scanner, stated)


def _surface(scan: Scan, zero: np.ndarray) -> Surface:
    """Cells that are known beside the region, and PLACES of the region, in machine coordinates."""
    nominal = scan.maps.get('nominal', np.full(scan.z.shape, np.nan))
    rows, columns = known_cells(scan.z, nominal, scan.region, scan.resolution)
    off = (scan.z - nominal)[rows, columns]
    laid = np.column_stack(np.nonzero(scan.region & np.isfinite(scan.z)))
    laid = (
        laid[np.linspace(0, len(laid) - 1, min(len(laid), PLACES)).astype(int)]
        if len(laid)
        else laid
    )
    cells = np.concatenate([np.column_stack([rows, columns]), laid]).astype(int)
    x = scan.origin[0] + (cells[:, 1] + 0.5) * scan.resolution
    y = scan.origin[1] + (cells[:, 0] + 0.5) * scan.resolution
    points = np.column_stack([x, y, scan.z[cells[:, 0], cells[:, 1]]]) + zero
    return Surface(points, np.concatenate([off, np.full(len(laid), np.nan)]))


def _station(bridge: dict[str, Any]) -> Station:
    a_b, d_b, d_c = map(float, bridge['positioner'])
    origin, low, high = (tuple(map(float, bridge[k])) for k in ('origin', 'work_low', 'work_high'))
    return Station(
        Place(
            positioner=Positioner(a_b=a_b, d_b=d_b, d_c=d_c),
            origin=origin, low=low, high=high, tilt=float(bridge.get('tilt') or 0.0),  # type: ignore[arg-type]
            turning=_turning(bridge),
        )
    )  # fmt: skip
