"""Requests to a served panel without a graph, and what its machine says."""

from __future__ import annotations

import asyncio
import time

import aiohttp

MACHINE = {
    'connected': True, 'silent': [], 'state': 'IDLE', 'fault': 0, 'fault_text': '', 'message': '',
    'armed': False, 'boot': 1, 'limit_min': [0.0, 0.0, 0.0], 'limit_max': [400.0, 300.0, 200.0],
    'work_offset': [100.0, 100.0, 20.0],
}  # fmt: skip


def wall(heights=(0, 2), lift: int = 12) -> str:
    """Two beads side by side per layer, 4 mm apart."""
    text = ['W4646', 'S22', 'F600', f'G0 Z{lift}']
    for k, z in enumerate(heights, 1):
        text.append(f'; layer {k}')
        for y in (0, 4):
            text += [f'G0 X0 Y{y}', f'G1 Z{z}', 'M3', 'G1 X40', 'M5', f'G0 Z{z + lift}']
    return '\n'.join(text)


def ask(panel, path: str, data: object, **options) -> tuple[int, dict]:
    async def go() -> tuple[int, dict]:
        headers = {'X-Waam-Csrf': panel.csrf, 'Origin': panel.url} | options.get('headers', {})
        body = data if isinstance(data, bytes) else None
        more = {'data': body} if body is not None else {'json': data}
        async with aiohttp.ClientSession() as session:
            async with session.post(f'{panel.url}/api/{path}', headers=headers, **more) as answer:
                return answer.status, await answer.json()

    return asyncio.run(go())


def machine_says(panel, **values) -> None:
    said = MACHINE | values
    panel.cell.mailbox.put(('machine', said))
    end = time.monotonic() + 20
    while panel.cell.state.sections.get('machine') != said:
        assert time.monotonic() < end
        time.sleep(0.02)
