"""The page *Commissioning*: its requests. What is asked, measured and judged is `waam commission`. No ROS."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from urllib.parse import quote

from aiohttp import web

from waam_node.job_folder import REPORT
from waam_process.safe_files import FileError, is_file, read_bytes
from waam_shop.roles import Role

from . import numbers
from .cell import CELL, Cell
from .commanding import BadRequest, Run, command_routes
from .operations import Refused
from .routes import Route
from .security import REPORT_POLICY

LONGEST = 200  # letters of an answer


async def start(cell: Cell, data: dict[str, Any]) -> str:
    """step: its name; none = all that are due, one after the other."""
    step = data.get('step', '')
    if not isinstance(step, str) or len(step) > LONGEST or step.startswith('-'):
        raise BadRequest('step: the name of a step, or none')
    cell.check_no_job()
    if cell.shop:
        cell.shop.stop_pressed()  # what is released in the queue would start in between
    await cell.commissioning.start(step)
    return 'the commissioning runs'


async def answer(cell: Cell, data: dict[str, Any]) -> str:
    """number: of the question; answer: a word of it, the name of a part where it wants a file, or as many numbers as it
    wants, as people type them."""
    asked = cell.commissioning.question(data.get('number'))
    if 'do' in asked and not asked['wait']:
        raise Refused('the cell looks for itself whether that is done')
    cell.commissioning.answer(asked['number'], _said(cell, asked, data.get('answer', '')))
    return 'told'


def _said(cell: Cell, asked: dict[str, Any], given: Any) -> str:
    if isinstance(given, str) and ('do' in asked or given in asked['words']):
        return given[:LONGEST]
    if isinstance(given, str) and asked['file']:
        return str(cell.parts.find(given))
    if not isinstance(given, list) or asked['words'] or len(given) != asked['count']:
        raise BadRequest(f'answer: wanted is {_wanted(asked)}')
    return ' '.join(f'{_number(value, asked):g}' for value in given)


def _wanted(asked: dict[str, Any]) -> str:
    words = [*asked['words'], *(['the name of a part'] if asked['file'] else [])]
    return ', '.join(words) or f'{asked["count"]} x {asked["unit"]}'


def _number(value: Any, asked: dict[str, Any]) -> float:
    low, high = (
        asked[end] if asked[end] is not None else far for end, far in (('low', -1e9), ('high', 1e9))
    )
    try:
        return numbers.of(value, low, high, asked['unit'])
    except numbers.NumberRefused as e:
        raise BadRequest(f'answer: {e}') from None


async def end(cell: Cell, _: dict[str, Any]) -> str:
    """As Ctrl-C on the command line."""
    if not cell.commissioning.running:
        raise Refused('no commissioning runs')
    cell.commissioning.end()
    return 'it ends'


async def _book(request: web.Request) -> web.Response:
    """Steps, their states and what was found; not ok with the reason why that is not known."""
    cell: Cell = request.app[CELL]
    try:
        book = await cell.commissioning.look(cell.state.job_running)
    except Refused as e:
        return web.json_response({'ok': False, 'message': str(e)})
    steps = await cell.background.thread('files', _with_reports, book['steps'], cell.jobs_dir)
    return web.json_response({'ok': True, **book, 'steps': steps})


def _with_reports(steps: list[dict[str, Any]], jobs: Path) -> list[dict[str, Any]]:
    """report: address of that of the job of a step, '' = it has none here."""
    return [row | {'report': _report(jobs, row.get('job', ''))} for row in steps]


def _report(jobs: Path, job: str) -> str:
    folder = Path(job)
    if not job or folder.parent.resolve() != jobs.resolve() or not is_file(folder / REPORT):
        return ''
    return f'/jobs/{quote(folder.name)}/report.html'


async def _file(request: web.Request) -> web.Response:
    """page.html (to print and sign), cell.yaml, or a picture that the book names."""
    cell: Cell = request.app[CELL]
    name = request.match_info['name']
    book = cell.commissioning.book or {'steps': []}
    drawn = {picture for row in book['steps'] for picture in row.get('pictures', ())}
    if name == 'page.html' and book['steps']:
        file, kind = Path(book['page']), 'text/html'
    elif name == 'cell.yaml' and book['steps']:
        file, kind = Path(book['file']), 'text/plain'
    elif name in drawn:
        file, kind = Path(book['page']).with_name(Path(name).name), 'image/png'
    else:
        raise web.HTTPNotFound(text='not known: open the page Commissioning first')
    try:
        body = await cell.background.thread('files', read_bytes, file)
    except FileError as e:
        raise web.HTTPNotFound(text=str(e)) from None
    charset = None if kind == 'image/png' else 'utf-8'
    headers = {'Content-Security-Policy': REPORT_POLICY}
    return web.Response(body=body, content_type=kind, charset=charset, headers=headers)


COMMANDS: dict[str, Run] = {
    'commission/start': start,
    'commission/answer': answer,
    'commission/end': end,
}
ROUTES = (
    Route('GET', '/api/commission', Role.VIEW, _book), Route('GET', '/commission/{name}', Role.VIEW, _file),
    *command_routes(COMMANDS, Role.OPERATE),
)  # fmt: skip
