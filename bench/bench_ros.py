"""What users of stock ROS 2 expect.

ros.jtc_refused: goals that the driver refused in 20 short jobs with goals that come 0 to 80 ms late and a clock that is
up to 50 ms ahead or behind; jobs that were refused before the arc count none. ros.jtc_cut: arcs that were cut in them.
The driver is that of the simulated cell, by the rules of ros2_controllers (baseline: jobs that were laid to the end).

ros.namespaced: of two cells in two namespaces of one domain, those whose job ends well and whose record holds
nothing of the other one (baseline: cells).
"""

from __future__ import annotations

import itertools
import sys
import tempfile
from pathlib import Path

from lib.emit import emit

ROOT = Path(__file__).parents[1]
TESTS = ROOT / 'waam_ws/src/waam_robot_bridge/test', ROOT / 'test'
JOBS_S = 900.0
DELAYS, OFFSETS = (0.0, 0.02, 0.04, 0.06, 0.08), (-0.05, -0.025, 0.025, 0.05)  # s
END = (0.05, 0.02, 0.17)  # m, 30 mm of a bead
sys.path += [str(t) for t in TESTS if str(t) not in sys.path]


def jtc() -> None:
    """One cell after the other: they keep step with the wall clock, at the priority that a real cell has."""
    from waam_node import priority

    print(
        f'# priority: {priority.request()}', file=sys.stderr
    )  # the processes of the cell inherit it
    refused = cut = laid = 0
    for delay, offset in itertools.product(DELAYS, OFFSETS):
        with tempfile.TemporaryDirectory() as logs:
            said, errors, whole = job(Path(logs), delay, offset)
        refused, cut, laid = refused + errors, cut + (not said and not whole), laid + whole
        told = said or f'{errors} goals refused, the bead is {"whole" if whole else "not whole"}'
        print(f'# late {delay * 1e3:.0f} ms, clock {offset * 1e3:+.0f} ms: {told}', file=sys.stderr)
    emit('ros.jtc_refused', refused, 'goals', 'jobs laid to the end', laid)
    emit('ros.jtc_cut', cut, 'jobs', 'jobs laid to the end', laid)


def job(logs: Path, delay: float, offset: float) -> tuple[str, int, bool]:
    """What the bridge said before the arc ('' = nothing), goals refused after that, and whether the bead was laid."""
    from bridge_graph import until
    from driver_cell import Cell

    cell = Cell(logs, delay=delay, offset=offset)
    try:
        answer = cell.arm()
        if answer.error_code:
            return answer.message, 0, False
        before = cell.log('driver').count('goal refused')
        cell.lay(END)
        until(lambda: 1 in cell.done or 'is cut' in cell.state.message, what='the bead')
        if 1 not in cell.done:
            print(f'# {cell.state.message}', file=sys.stderr)
        return '', cell.log('driver').count('goal refused') - before, 1 in cell.done
    finally:
        cell.close()


def namespaced() -> None:
    """Each lays one layer in a worn block, at the same time."""
    import numpy as np
    from two_cells import lay_both, two_cells

    from waam_node.stl import write_worn_block
    from waam_node.testing import fresh_domain

    x, y = np.linspace(0, 36, 37), np.linspace(0, 30, 31)
    worn = np.full((31, 37), 1.5) * (np.hypot(*np.meshgrid(x - 18, y - 15)) < 10)
    with tempfile.TemporaryDirectory() as folder:
        part = write_worn_block(Path(folder), x, y, 12.0, worn)
        values = {'cell1': {'bridge': {'speed_max': 0.4}}, 'cell2': {'bridge': {'speed_max': 0.3}}}
        with two_cells(Path(folder), fresh_domain(), values) as cells:
            lay_both(cells, part, JOBS_S)
        good = [not c.results[0].error_code and not c.strangers() for c in cells]
    emit('ros.namespaced', sum(good), 'cells', 'cells', len(good))


FIGURES = {'ros.jtc_refused': jtc, 'ros.jtc_cut': jtc, 'ros.namespaced': namespaced}
