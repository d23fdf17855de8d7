"""The page *Standoff*: what the torch is held at its distance by, and at which; in mm. No ROS."""

from __future__ import annotations

import math
from typing import Any

from aiohttp import web

from waam_process.names import STANDOFF_LAWS, STANDOFF_SOURCES
from waam_shop.roles import Role

from .api import number
from .cell import CELL, Cell
from .commanding import BadRequest, command_routes
from .operations import Refused, StandoffSettings
from .routes import Route

LIMITS_MM = {
    'set_mm': (5.0, 400.0), 'up_mm': (0.0, 20.0), 'down_mm': (0.0, 20.0), 'wander_mm': (0.0, 5.0),
}  # fmt: skip


def settings_of(data: dict[str, Any]) -> StandoffSettings:
    """What the page asks for; set_mm null = what fits the source. Raises BadRequest."""
    if data.get('source') not in STANDOFF_SOURCES or data.get('law') not in STANDOFF_LAWS:
        raise BadRequest(f'source: {", ".join(STANDOFF_SOURCES)}; law: {", ".join(STANDOFF_LAWS)}')
    set_mm = math.nan if data.get('set_mm') is None else _mm(data, 'set_mm')
    mm = (set_mm, *(_mm(data, name) for name in ('up_mm', 'down_mm', 'wander_mm')))
    return StandoffSettings(data['source'], data['law'], *(v * 1e-3 for v in mm))


def _mm(data: dict[str, Any], name: str) -> float:
    return number(data, name, *LIMITS_MM[name], 'mm')


async def set_standoff(cell: Cell, data: dict[str, Any]) -> str:
    """source, law, set_mm (null = what fits the source), up_mm, down_mm, wander_mm: for the jobs to come."""
    wanted = settings_of(data)
    if cell.state.job_running:
        raise Refused('a job is running; the standoff control is set between jobs')
    return await cell.do(cell.operations.set_standoff, wanted)


async def _settings(request: web.Request) -> web.Response:
    """What is set now, and the limits of the page."""
    cell: Cell = request.app[CELL]
    limits = {'sources': STANDOFF_SOURCES, 'laws': STANDOFF_LAWS, 'limits_mm': LIMITS_MM}
    try:
        found: StandoffSettings = await cell.do(cell.operations.standoff)
    except Refused as e:
        return web.json_response({'ok': False, 'message': str(e), **limits})
    distance = None if math.isnan(found.distance) else _told(found.distance)
    values = {'source': found.source, 'law': found.law, 'set_mm': distance}
    values |= {f'{n}_mm': _told(getattr(found, n)) for n in ('up', 'down', 'wander')}
    return web.json_response({'ok': True, **values, **limits})


def _told(value: float) -> float:
    return round(value * 1e3, 3)


ROUTES = (
    Route('GET', '/api/standoff', Role.VIEW, _settings),
    *command_routes({'standoff': set_standoff}, Role.OPERATE),
)
