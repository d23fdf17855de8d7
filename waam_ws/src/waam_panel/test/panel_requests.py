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


def ask(panel, path: str, data: object = None) -> tuple[int, dict]:
    """A command of our own page; bytes are sent as they are."""

    async def go() -> tuple[int, dict]:
        headers = {'X-Waam-Csrf': panel.csrf, 'Origin': panel.url}
        more = {'data': data} if isinstance(data, bytes) else {'json': data or {}}
        async with aiohttp.ClientSession() as session:
            async with session.post(f'{panel.url}/api/{path}', headers=headers, **more) as answer:
                return answer.status, await answer.json()

    return asyncio.run(go())


def get(panel, path: str) -> tuple[int, bytes]:
    async def go() -> tuple[int, bytes]:
        async with aiohttp.ClientSession() as session, session.get(panel.url + path) as answer:
            return answer.status, await answer.read()

    return asyncio.run(go())


def until(condition, what: str, timeout: float = 60.0) -> None:
    end = time.monotonic() + timeout
    while not condition():
        assert time.monotonic() < end, what
        time.sleep(0.02)


def machine_says(panel, **values) -> None:
    tell(panel, 'machine', MACHINE | values)


def tell(panel, name: str, value: object) -> None:
    """As a callback would; waits until the page can see it."""
    panel.cell.mailbox.put((name, value))
    until(lambda: panel.cell.state.sections.get(name) == value, name)
