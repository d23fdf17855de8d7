"""Many cells: how fast the page of all cells is there.

panel.first_paint_ms: the page /cells of a panel with 4 cells, 250 open items in the queue of each and 1000 job folders
(no ROS; four panels in this process): from the request to the first paint in which the cards of all four cells stand,
median of 9 loads in fresh browser profiles (baseline: the limit, 1000 ms). Needs playwright and Chromium.
"""

from __future__ import annotations

import json
import shutil
import sys
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path

import numpy as np
from lib.emit import emit
from lib.limit import within

CELLS, ITEMS, JOBS, LOADS = 4, 250, 1000, 9
MACHINE = {
    'connected': True, 'silent': [], 'state': 'IDLE', 'fault': 0, 'fault_text': '', 'message': '', 'armed': False,
}  # fmt: skip
DRAWN = """() => new Promise((done) => {
  const look = () => document.querySelectorAll('.card.up').length === CELLS
    ? requestAnimationFrame(() => setTimeout(() => done(performance.now()), 0)) : requestAnimationFrame(look);
  look();
})""".replace('CELLS', str(CELLS))


def fill(jobs: Path) -> None:
    """Folders of jobs that are done, as far as the list of jobs reads them."""
    for n in range(JOBS):
        folder = jobs / f'20260101T{n:06d}Z_block'
        folder.mkdir(parents=True)
        (folder / 'job.yaml').write_text('job_id: block\n')
        (folder / 'status.json').write_text('{"state": "DONE"}')
        report = {'part': 'block.stl', 'verdict': 'in tolerance', 'closed_loop': {'rms_mm': 0.08}}
        (folder / 'report.json').write_text(json.dumps(report))


def panel(stack: ExitStack, folder: Path, name: str):
    """A served panel without ROS, its queue filled."""
    sys.path.insert(0, str(Path(__file__).parents[1] / 'waam_ws/src/waam_panel/test'))
    from conftest import FakeOperations

    from waam_panel.cell import Cell
    from waam_panel.in_shop import Place
    from waam_panel.parts import PartFolders
    from waam_panel.security import Guard
    from waam_panel.shop_link import ShopLink
    from waam_panel.state import PanelState
    from waam_panel.web import WebServer
    from waam_shop.job_queue import Queue
    from waam_shop.notifier import Notifier
    from waam_shop.notify_settings import NotifySettings
    from waam_shop.shop_folder import Shop
    from waam_view.mailbox import Mailbox

    cells, shop = [], Shop(folder / 'shop')
    queue = Queue()
    for n in range(ITEMS):
        queue = queue.add({'part': f'block-{n}.stl', 'material': 'er70s-6'}, 'Ada', 1e9 + n)
    shop.queue(name).change(lambda _: queue)

    def make(port: int) -> Cell:
        cells.append(Cell(
            guard=Guard.create(None, '127.0.0.1', port), state=PanelState(100), operations=FakeOperations(),
            mailbox=Mailbox(), convert=lambda _, message: message, parts=PartFolders((folder / 'parts',)),
            jobs_dir=folder / 'jobs', materials=('er70s-6',),
            shop=ShopLink(shop, Place(name), Notifier(NotifySettings(), name)),
        ))  # fmt: skip
        return cells[-1]

    server = WebServer(make, '127.0.0.1', 0)
    assert not server.problem, server.problem
    stack.callback(server.close)
    cells[0].mailbox.put(('machine', MACHINE))
    return server, shop


def first_paint() -> None:
    """The page of all cells in Chromium."""
    from playwright.sync_api import sync_playwright

    chromium = shutil.which('chromium') or shutil.which('google-chrome')
    if not chromium:
        raise RuntimeError('chromium is not installed (apt-get install chromium)')
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix='waam_cells_bench_')))
        fill(folder / 'jobs')
        served = [panel(stack, folder, f'cell{n}') for n in range(1, CELLS + 1)]
        until = time.monotonic() + 20
        while len(served[0][1].cells()) < CELLS and time.monotonic() < until:
            time.sleep(0.1)
        p = stack.enter_context(sync_playwright())
        browser = p.chromium.launch(executable_path=chromium, args=['--no-sandbox'])
        stack.callback(browser.close)
        with within(180, 'loading the page of cells'):
            took = [
                _load(browser, f'http://127.0.0.1:{served[0][0].port}/cells') for _ in range(LOADS)
            ]
    print(f'# {", ".join(f"{t:.0f}" for t in sorted(took))} ms', file=sys.stderr)
    emit('panel.first_paint_ms', float(np.median(took)), 'ms', 'limit', 1000.0)


def _load(browser, url: str) -> float:
    context = browser.new_context(viewport={'width': 1280, 'height': 800})
    try:
        page = context.new_page()
        page.goto(url, wait_until='commit')
        return float(page.evaluate(DRAWN))
    finally:
        context.close()


FIGURES = {'panel.first_paint_ms': first_paint}
