"""A person at a simulated cell that is commissioned, for tests and benchmarks: presses, looks and measures there. The
wizard sees nothing of this; what is wrong with the cell is in the parameters of its plant alone."""

from __future__ import annotations

import json

import numpy as np
from std_srvs.srv import Trigger

from waam_msgs.srv import InjectFault

from .commission_cell import CommissionedCell
from .commission_steps import SWITCHES, Question

GAUGE_MM = 0.01  # standard deviation of a length that is read
RULE_MM = 0.5  # of a piece of wire
AMPERES, VOLTS, WARMER_K = 20.0, 24.0, 15.0
LISTENS = 30  # frames of telemetry

DOES = {  # action -> fault of the cell, value; all others only make an end of it
    'estop.press': ('estop_pressed', 0.0),
    'signals.current': ('test_current', AMPERES),
    'signals.voltage': ('test_voltage', VOLTS),
    'temperature.warm': ('warm_hand', WARMER_K),
    **{f'limits.{name}': ('limit_pressed', 0.0) for name in SWITCHES},
}
LETS_GO = ('_off', '.cool', '.out')
SAYS = {'signals.current_told': f'{AMPERES:g}', 'signals.voltage_told': f'{VOLTS:g}'}


class Hand:
    """`ask` and `do` of an operator. seed: of the errors of reading."""

    def __init__(self, cell: CommissionedCell, seed: int = 0) -> None:
        self._cell = cell
        self._rng = np.random.default_rng(seed)
        self._marks: dict[str, np.ndarray] = {}
        self._at = np.zeros(3)
        self._fed = self._gassed = 0.0
        self.asked: list[str] = []

    def _look(self) -> dict:
        return json.loads(self._cell.ask(Trigger, 'cell/look', Trigger.Request()).message)

    def _torch(self) -> np.ndarray:
        return np.array(self._look()['torch_mm'])

    def _put(self, fault: str, value: float) -> None:
        request = InjectFault.Request(fault=fault, value=value)
        answer = self._cell.ask(InjectFault, 'cell/inject_fault', request)
        assert answer.success, answer.message

    def do(self, action: str, text: str, wait: bool) -> None:
        """Does it at once."""
        name = action.rpartition('.')[2]
        if action in DOES:
            self._put(*DOES[action])
        elif action.endswith(LETS_GO):
            self._put('none', 0.0)
        elif name.startswith('mark_'):
            self._marks[name] = self._torch()
        elif name.endswith(('_look', '_zero')):
            self._at = self._torch()
        elif action == 'gas.listen':
            self._gassed = self._look()['gas_s']

    def ask(self, question: Question) -> str:
        """What a person would see."""
        self.asked.append(question.id)
        step, _, name = question.id.partition('.')
        if question.id in SAYS:
            return SAYS[question.id]
        if step == 'directions' and name in 'xyz':
            return self._way()
        if question.id == 'temperature.told':
            return f'{self._look()["spot_c"] + self._rng.normal(0, 0.5):.1f}'
        if step == 'steps' and name != 'ready':
            return f'{self._length(self._at, self._torch()):.3f}'
        if step == 'skew' and name != 'ready':
            a, b = {'side': (1, 2), 'rising': (1, 3), 'falling': (2, 4)}[name]
            return f'{self._length(self._marks[f"mark_{a}"], self._marks[f"mark_{b}"]):.3f}'
        if step == 'gas' and name != 'ready':
            return self._hears(name)
        if name.startswith('piece_'):
            return self._piece()
        if question.id == 'wire.ready':
            self._fed = self._look()['wire_mm']
        return 'yes'

    def _way(self) -> str:
        gone = self._torch() - self._at
        axis = int(np.abs(gone).argmax())
        if abs(gone[axis]) < 1.0:
            return 'none'
        return f'{"+" if gone[axis] > 0 else "-"}{"xyz"[axis]}'

    def _length(self, a: np.ndarray, b: np.ndarray) -> float:
        return float(np.linalg.norm(b - a) + self._rng.normal(0, GAUGE_MM))

    def _hears(self, name: str) -> str:
        """Gas at the nozzle, for a moment at rest, or since the valve was told to open."""
        if name == 'at_rest':
            self._gassed = self._look()['gas_s']
            self._cell.fresh(LISTENS)
        return 'yes' if self._look()['gas_s'] > self._gassed + 0.05 else 'no'

    def _piece(self) -> str:
        before, self._fed = self._fed, self._look()['wire_mm']
        return f'{self._fed - before + self._rng.normal(0, RULE_MM):.1f}'
