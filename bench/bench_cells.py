"""Many cells: how fast the page of all cells is there, and what a second cell costs the loop of the first.

panel.first_paint_ms: the page /cells of a panel with 4 cells, 250 open items in the queue of each and 1000 job folders
(no ROS; four panels in this process): from the request to the first paint in which the cards of all four cells stand,
median of 9 loads in fresh browser profiles (baseline: the limit, 1000 ms). Needs playwright and Chromium.

cells.loop_p99_growth_pct: growth of the 99th percentile of the loop's latency (bench_view.py) of one cell at work,
when a second, idle cell is up beside it on the same network; runs alternate (baseline: the limit, 10 %). Each cell has
half of the cores to itself, with and without the other one, as each has a computer of its own in a shop: the network is
what they share. Meaningful on an idle machine only.

WAAM_VIEW_BENCH_S, WAAM_VIEW_BENCH_RUNS as in bench_view.py: 7 minutes.
"""

from __future__ import annotations

import json
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
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
    from waam_panel.operations import Place
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


@contextmanager
def on_cores(cores: list[int]) -> Iterator[None]:
    """What is started here, threads and processes, keeps to these cores."""
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, cores)
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)


def side_by_side() -> None:
    """The loop of a cell at work, with and without an idle cell beside it."""
    from bench_view import RUNS, SECONDS, START_S, measure

    from waam_bringup.graph import Settings
    from waam_bringup.operate import graph

    cores = sorted(os.sched_getaffinity(0))
    half = len(cores) // 2
    if not half:
        raise RuntimeError('two cells need two cores')
    pooled: dict[bool, list[np.ndarray]] = {False: [], True: []}
    for number in range(RUNS):
        for beside in (False, True) if number % 2 == 0 else (True, False):
            with ExitStack() as stack, within(2 * START_S + SECONDS, 'a run of two cells'):
                folder = Path(
                    stack.enter_context(tempfile.TemporaryDirectory(prefix='waam_cells_'))
                )
                if beside:
                    idle = Settings(run=folder / 'second', seed=8, rate=1.0)
                    with on_cores(cores[half:]):
                        stack.enter_context(graph(idle, 97, 90.0))
                with on_cores(cores[:half]):
                    pooled[beside].append(measure(folder, True, 98))
            shown = np.percentile(pooled[beside][-1] * 1e3, [50, 99])
            kind = 'two cells' if beside else 'one cell'
            print(
                f'# {kind}: p50 {shown[0]:.2f} ms, p99 {shown[1]:.2f} ms',
                file=sys.stderr,
                flush=True,
            )
    one, two = (float(np.percentile(np.concatenate(pooled[k]) * 1e3, 99)) for k in (False, True))
    emit('cells.loop_p99_growth_pct', 100 * (two / one - 1), '%', 'limit', 10.0)


FIGURES = {'panel.first_paint_ms': first_paint, 'cells.loop_p99_growth_pct': side_by_side}
