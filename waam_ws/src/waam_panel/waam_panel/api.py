"""Commands, lists and pictures: /api/... Every command is a POST with JSON (stop also as a plain form)."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

from aiohttp import web

from waam_node.stop_socket import HOLD, STOP
from waam_process.operating import SPEED_FACTOR, WIRE_FACTOR
from waam_shop.roles import Role

from . import alarms, bodies, calibrated, history, numbers
from .archive_page import QuestionError
from .auditing import done
from .cell import CELL, Cell
from .commanding import (
    BadRequest,
    Run,
    answered,
    command_routes,
    read_route,
    session_of,
    upload_route,
)
from .operations import Refused
from .routes import Route
from .security import CSRF_HEADER
from .setup_form import LAST_SCAN, LIMITS, LOOP_MODE_LABELS, parse
from .spool import spool_of

STEPS_MM = (0.1, 1.0, 10.0, 50.0)
JOG_SPEED = {0.1: 2e-3, 1.0: 5e-3, 10.0: 20e-3, 50.0: 40e-3}  # m/s per step size
HOLD_SPEED = {0.1: 0.5e-3, 1.0: 2e-3, 10.0: 10e-3, 50.0: 30e-3}  # m/s while a key is held
# motion that one request of a held key asks for: without the next one the machine stands
HOLD_S = 0.25
WIRE_MM = 50.0  # longest wire jog of one request
FACTORS = {'speed': SPEED_FACTOR, 'wire': WIRE_FACTOR}


def number(data: dict[str, Any], name: str, low: float, high: float, unit: str = '') -> float:
    """A number within limits, of JSON or as people type it. Raises BadRequest."""
    try:
        return numbers.of(data.get(name), low, high, unit)
    except numbers.NumberRefused as e:
        raise BadRequest(f'{name}: {e}') from None


# ---- what the commands do


async def stop(cell: Cell, _: dict[str, Any]) -> str:
    """Ends the job and stops the machine; Refused only when neither answers. A release is withdrawn, a commissioning
    ends."""
    cell.at_once(STOP)
    cell.commissioning.end()
    if cell.shop:
        cell.shop.stop_pressed()
    return await cell.do(cell.operations.stop)


async def pause(cell: Cell, _: dict[str, Any]) -> str:
    """Holds the machine at once; a job that runs waits as well."""
    cell.at_once(HOLD)
    return await cell.do(cell.operations.pause, cell.state.job_running)


async def resume(cell: Cell, _: dict[str, Any]) -> str:
    """Goes on: the job when one runs, else the machine alone."""
    return await cell.do(cell.operations.resume, cell.state.job_running)


def machine(name: str) -> Run:
    """The command of this name (HOME, DISARM, RESET)."""

    async def run(cell: Cell, _: dict[str, Any]) -> str:
        return await cell.do(cell.operations.command, name)

    return run


async def arm(cell: Cell, _: dict[str, Any]) -> str:
    """Arms the cell for the part that is loaded, or for the job that is to be resumed. Refused without one."""
    if cell.setup is not None:
        name = cell.setup.part
    elif cell.going_on is not None:
        name = cell.going_on.name
    else:
        raise Refused('load a part first')
    return await cell.do(cell.operations.arm, f'panel {name}')


async def jog(cell: Cell, data: dict[str, Any]) -> str:
    """axis x, y, z; direction +1, -1; step in mm; held: a short piece at the speed that belongs to the step."""
    axis, step, held = data.get('axis'), data.get('step'), data.get('held', False)
    known = axis in ('x', 'y', 'z') and step in STEPS_MM and data.get('direction') in (1, -1)
    numbers = isinstance(step, int | float) and not isinstance(step, bool)
    if not known or not numbers or data['direction'] is True or held not in (True, False):
        raise BadRequest(
            'jog: axis x, y or z; step 0.1, 1, 10 or 50; direction 1 or -1; held true or false'
        )
    assert step is not None  # a number, asked above
    speed = HOLD_SPEED[step] if held else JOG_SPEED[step]
    length = data['direction'] * (speed * HOLD_S if held else step * 1e-3)
    move = tuple(length if a == axis else 0.0 for a in 'xyz')
    return await cell.do(cell.operations.jog, move, speed)


async def jog_wire(cell: Cell, data: dict[str, Any]) -> str:
    """mm: -50 to 50, negative = back."""
    length = number(data, 'mm', -WIRE_MM, WIRE_MM, 'mm')
    return await cell.do(cell.operations.jog_wire, length * 1e-3)


async def zero(cell: Cell, _: dict[str, Any]) -> str:
    """The present position becomes the work zero."""
    return await cell.do(cell.operations.set_zero)


async def override(cell: Cell, data: dict[str, Any]) -> str:
    """speed, wire: factors; what is missing stays."""
    given = {n: number(data, n, *limits) for n, limits in FACTORS.items() if n in data}
    if not given or len(given) != len(data):
        limits = (f'{name} {low:g} to {high:g}' for name, (low, high) in FACTORS.items())
        raise BadRequest(f'override: {", ".join(limits)}')
    nan = math.nan
    return await cell.do(cell.operations.override, given.get('speed', nan), given.get('wire', nan))


async def gain(cell: Cell, data: dict[str, Any]) -> str:
    """value 0 to 0.5, or null: the correction server's own."""
    value = math.nan if data.get('value') is None else number(data, 'value', 0.0, 0.5)
    return await cell.do(cell.operations.adjust, 'SET_K_GAIN', value)


def adjust(what: str) -> Run:
    """The request of this name (RESCAN, SKIP_LAYER) to the running job."""

    async def run(cell: Cell, _: dict[str, Any]) -> str:
        return await cell.do(cell.operations.adjust, what, 0.0)

    return run


async def acknowledge(cell: Cell, data: dict[str, Any]) -> str:
    """id: number of an alarm; null or missing = all. BadRequest for anything else."""
    which = data.get('id')
    if which is not None and (not isinstance(which, int) or isinstance(which, bool)):
        raise BadRequest('id: the number of an alarm, or null for all')
    count = cell.state.alarms.acknowledge(which)
    return f'{count} acknowledged' if count else 'nothing to acknowledge'


async def load(cell: Cell, data: dict[str, Any]) -> str:
    """Checks the setup and takes it; on the simulated cell the part is put on the table."""
    cell.check_no_job()
    setup = parse(data, cell.materials)
    cell.parts.find(setup.part)
    named = setup.as_found and setup.as_found != LAST_SCAN
    as_found = cell.parts.find(setup.as_found) if named else None
    said = await cell.do(cell.operations.load, setup, await cell.on_table(setup, as_found))
    cell.setup, cell.going_on = setup, None
    cell.state.sections['setup'] = setup.as_dict() | {'words': setup.words}
    return f'{said}: {setup.words}'


async def load_job(cell: Cell, data: dict[str, Any]) -> str:
    """id: a job that was interrupted, failed or aborted; Arm and Start then go on with it."""
    cell.check_no_job()
    folder = history.find(cell.jobs_dir, str(data.get('id')))
    if not history.can_go_on(folder):
        raise Refused(f'{folder.name} is not an interrupted job')
    cell.setup, cell.going_on = None, folder
    cell.state.sections['setup'] = {
        'part': f'{folder.name}, to go on',
        'words': f'go on with {folder.name} at the first bead that is not done',
    }
    return 'loaded; Arm and Start scan the part and go on at the first bead that is not done'


async def preview(cell: Cell, _: dict[str, Any]) -> dict[str, Any]:
    """Plans the loaded part; the picture is then at /api/preview.png."""
    if cell.setup is None:
        raise Refused('load a part first')
    return {'table': await cell.make_preview(cell.setup)}


async def start(cell: Cell, _: dict[str, Any]) -> str:
    """The two steps of a machine tool: arm, then start."""
    if cell.setup is None and cell.going_on is None:
        raise Refused('load a part first')
    cell.check_no_job()
    if not (cell.state.sections.get('machine') or {}).get('armed'):
        raise Refused('press Arm first')
    await calibrated.check(cell.calibrations, cell.settings)
    if cell.going_on is not None:
        return await cell.do(cell.operations.resume_job, cell.going_on)
    setup = cell.setup
    assert setup is not None  # asked above
    part = cell.parts.find(setup.part)
    said = await cell.do(cell.operations.start, setup, part, cell.jobs_dir)
    if cell.setup is setup:  # another start would find less on the spool
        cell.setup = replace(setup, wire_left_m=0.0)
        cell.state.sections['setup'] = cell.setup.as_dict() | {'words': cell.setup.words}
    return said


async def restart_programs(cell: Cell, _: dict[str, Any]) -> str:
    """Starts again what has died or hangs. Refused while the arc is on, the machine moves or holds, or a job runs."""
    stale = cell.state.stale(time.monotonic())
    known = {n: v for n, v in cell.state.sections.items() if n not in stale and v}
    telemetry, machine = known.get('telemetry', {}), known.get('machine', {})
    if telemetry.get('arc') or telemetry.get('arc_enabled'):
        raise Refused('the arc is on: press STOP first')
    if {telemetry.get('state'), machine.get('state')} & {'RUN', 'HOLD'}:
        raise Refused('the machine moves or holds: press STOP first')
    if cell.state.job_running and 'job' in known:
        raise Refused('a job is running: press STOP first')
    return await cell.do(cell.operations.restart_programs)


COMMANDS: dict[str, Run] = {
    'pause': pause, 'resume': resume, 'home': machine('HOME'), 'disarm': machine('DISARM'), 'reset': machine('RESET'),
    'arm': arm, 'jog': jog, 'jog_wire': jog_wire, 'zero': zero, 'override': override, 'gain': gain,
    'rescan': adjust('RESCAN'), 'skip_layer': adjust('SKIP_LAYER'), 'acknowledge': acknowledge, 'load': load,
    'load_job': load_job,    'preview': preview, 'start': start, 'restart_programs': restart_programs,
}  # fmt: skip


# ---- requests


async def _stop(request: web.Request) -> web.Response:
    """Works from a script (JSON answer) and as a plain form without any script (back to the page). The log waits. The
    body is read only where the browser does not say whose page it is, and then a few hundred bytes of it."""
    cell: Cell = request.app[CELL]
    csrf = request.headers.get(CSRF_HEADER, '')
    if not csrf and 'Origin' not in request.headers:
        csrf = (await bodies.form(request)).get('csrf', '')
    cell.guard.check_stop(request.headers, session_of(request), csrf)
    answer = await done(request, 'stop', await answered(stop, cell, {}))
    if request.content_type == bodies.FORM_TYPE:
        raise web.HTTPSeeOther('/')
    return answer


async def _archive(request: web.Request) -> web.Response:
    """All jobs: rows, and the chart of a figure. New jobs are taken in first, but never beside a running one."""
    from waam_archive.catalog import ArchiveError

    cell: Cell = request.app[CELL]
    look = not cell.state.job_running
    try:
        found = await cell.background.thread(
            'archive', cell.archive.answer, dict(request.query), look
        )
    except QuestionError as e:
        return web.json_response({'ok': False, 'message': str(e)}, status=400)
    except (ArchiveError, OSError) as e:
        return web.json_response({'ok': False, 'message': f'the archive: {e}'}, status=500)
    return web.json_response({'ok': True, **found})


def _choices(cell: Cell) -> dict[str, Any]:
    return {
        'parts': cell.parts.listing(), 'materials': cell.materials, 'steps_mm': STEPS_MM,
        'override_limits': FACTORS, 'limits': LIMITS, 'simulated': cell.operations.simulated,
        'loop_modes': list(LOOP_MODE_LABELS.items()),
        'alarms': {k: {c: vars(a) for c, a in t.items()} for k, t in alarms.table().items()},
    }  # fmt: skip


async def _map(request: web.Request) -> web.Response:
    cell: Cell = request.app[CELL]
    version, picture = cell.state.maps.get(request.match_info['name'], (0, None))
    if picture is None:
        raise web.HTTPNotFound
    return web.json_response(picture | {'version': version})


async def _preview(request: web.Request) -> web.Response:
    cell = request.app[CELL]
    try:
        picture = await cell.background.thread('files', cell.preview.read_bytes)
    except OSError:
        raise web.HTTPNotFound from None
    return web.Response(body=picture, content_type='image/png')


def _spool(cell: Cell) -> dict[str, Any] | None:
    """Wire of the job that runs, or of the last one."""
    job = cell.state.sections.get('job') or {}
    return spool_of(Path(job['dir']), job.get('pass') or 1) if job.get('dir') else None


ROUTES = (
    # whoever sees the page may stop
    Route('POST', '/api/stop', Role.VIEW, _stop, bodies.FORM),
    upload_route('parts', 'upload', lambda cell: cell.parts),
    Route('GET', '/api/map/{name}', Role.VIEW, _map), Route('GET', '/api/preview.png', Role.VIEW, _preview),
    Route('GET', '/api/archive', Role.VIEW, _archive), read_route('/api/choices', _choices),
    read_route('/api/spool', _spool),
    read_route('/api/jobs', lambda cell: history.jobs(cell.jobs_dir)),
    *command_routes(COMMANDS, Role.OPERATE),
)  # fmt: skip
