"""A person at a simulated cell that is commissioned, for tests and benchmarks: presses, looks and measures there. The
wizard sees nothing of this; what is wrong with the cell is in the parameters of its plant alone."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from std_srvs.srv import Trigger

from waam_job.model.goal import JobGoal, check
from waam_msgs.srv import InjectFault
from waam_node.stl import block, write_stl
from waam_process.grid import GridSpec, HeightGrid
from waam_process.operating import BUILD_PLATE, DEFAULT_MATERIAL

from .commission_cell import CommissionedCell
from .commission_scanner import HEIGHT_MM, SLOPE_DEG, TOP_MM
from .commission_still import SWITCHES
from .commission_visit import Question

GAUGE_MM = 0.01  # standard deviation of a length that is read
RULE_MM = 0.5  # of a piece of wire
TOUCH_MM = 0.02  # of the wire tip on an artefact
AMPERES, VOLTS, WARMER_K, HOTTER_K = 20.0, 24.0, 15.0, 180.0
LISTENS = 30  # frames of telemetry
STANDS_MM = (70.0, 60.0)  # the artefact, work frame
PAD_MM, WORN_MM = (54.0, 42.0, 14.0), 4.0  # the part, and how deep it is worn
CELL_M = 0.4e-3  # of its map: that of the simulated metal
DIAL_STEPS = 6  # that it takes at the pyrometer

DOES = {  # action -> fault of the cell, value; all others only make an end of it
    'estop.press': ('estop_pressed', 0.0),
    'signals.current': ('test_current', AMPERES),
    'signals.voltage': ('test_voltage', VOLTS),
    'temperature.warm': ('warm_hand', WARMER_K),
    'pyrometer.heat': ('warm_hand', HOTTER_K),
    **{f'limits.{name}': ('limit_pressed', 0.0) for name in SWITCHES},
}
LETS_GO = ('_off', '.cool', '.out')
SAYS = {'signals.current_told': f'{AMPERES:g}', 'signals.voltage_told': f'{VOLTS:g}'}


def worn_pad(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Height (mm) of the top of a small part: a trough with soft flanks; the rim is intact."""
    length, width, height = PAD_MM
    u, v = np.abs((x - length / 2) / (0.4 * length)), np.abs((y - width / 2) / (0.38 * width))
    trough = np.clip((1.0 - (u**4 + v**4) ** 0.25) / 0.35, 0.0, 1.0)
    return height - WORN_MM * trough * trough * (3 - 2 * trough)


def write_pad(folder: Path) -> tuple[Path, Path]:
    """Meshes of it as it should be, and worn."""
    length, width, height = PAD_MM
    x, y = (np.linspace(0.0, end, round(end) + 1) for end in (length, width))
    ends = np.array([0.0, length]), np.array([0.0, width])
    nominal, worn = folder / 'pad_nominal.stl', folder / 'pad_worn.stl'
    write_stl(nominal, block(np.full((2, 2), height), *ends), 'pad, nominal, mm')
    write_stl(worn, block(worn_pad(*np.meshgrid(x, y)), x, y), 'pad, worn, mm')
    return nominal, worn


class Hand:
    """`ask` and `do` of an operator. seed: of the errors of reading; nominal, worn: meshes of the part, mm."""

    def __init__(
        self, cell: CommissionedCell, seed: int = 0, nominal: Path = Path(), worn: Path = Path()
    ) -> None:
        self._cell, self._part = cell, (nominal, worn)
        self._rng = np.random.default_rng(seed)
        self._marks: dict[str, np.ndarray] = {}
        self._read: list[float] = []  # written down since the last answer
        self._at = np.zeros(3)
        self._fed = self._gassed = 0.0
        self._early = False  # gas flowed before the valve was told to open
        self._dial = 1.0
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
        step, _, name = action.partition('.')
        doings: dict[str, Callable[[], None]] = {
            'gas.listen': self._listen, 'scanner.artefact': self._artefact, 'arc.plate': self._plate,
            'pyrometer.set': self._turn_the_dial, 'part.place': self._place,
        }  # fmt: skip
        if action in DOES:
            self._put(*DOES[action])
        elif action in doings:
            doings[action]()
        elif action.endswith(LETS_GO):
            self._put('none', 0.0)
        elif name.startswith('mark_'):
            self._marks[name] = self._torch()
        elif name.startswith('cut_'):
            before, self._fed = self._fed, self._look()['wire_mm']
            self._read.append(self._fed - before + self._rng.normal(0, RULE_MM))
        elif '_read_' in name:
            self._read.append(self._length(self._at, self._torch()))
        elif name.endswith(('_look', '_zero')):
            self._at = self._torch()

    def ask(self, question: Question) -> str:
        """What a person would see."""
        self.asked.append(question.id)
        step, _, name = question.id.partition('.')
        if question.id in SAYS:
            return SAYS[question.id]
        if step == 'directions' and name in 'xyz':
            return self._way()
        if name == 'told':
            return f'{self._contact():.1f}'
        if question.id in ('steps.x', 'steps.y', 'steps.z', 'wire.pieces'):
            read, self._read = self._read, []
            return ' '.join(f'{v:.3f}' for v in read)
        if question.id == 'skew.diagonals':
            ends = ((1, 3), (2, 4))
            found = [self._length(*(self._marks[f'mark_{n}'] for n in pair)) for pair in ends]
            return ' '.join(f'{v:.3f}' for v in found)
        if question.id == 'gas.flowed':
            flowed = self._look()['gas_s'] > self._gassed + 0.05
            return 'always' if self._early else 'opened' if flowed else 'never'
        if question.id == 'part.nominal':
            return str(self._part[0])
        if question.id == 'wire.ready':
            self._fed, self._read = self._look()['wire_mm'], []
        return 'yes'

    def _contact(self) -> float:
        """What a thermometer says where the temperature is measured, degrees Celsius."""
        return self._look()['spot_c'] + self._rng.normal(0, 0.5)

    def _way(self) -> str:
        gone = self._torch() - self._at
        axis = int(np.abs(gone).argmax())
        if abs(gone[axis]) < 1.0:
            return 'none'
        return f'{"+" if gone[axis] > 0 else "-"}{"xyz"[axis]}'

    def _length(self, a: np.ndarray, b: np.ndarray) -> float:
        return float(np.linalg.norm(b - a) + self._rng.normal(0, GAUGE_MM))

    def _listen(self) -> None:
        """Gas at the nozzle for a moment at rest."""
        before = self._look()['gas_s']
        self._cell.fresh(LISTENS)
        self._gassed = self._look()['gas_s']
        self._early = self._gassed > before + 0.05

    def _turn_the_dial(self) -> None:
        """Until the instrument says what the thermometer does."""
        for _ in range(DIAL_STEPS):
            read, true = self._cell.warmth(), self._contact()
            self._dial *= (read + 273.15 - 250.0) / (true + 273.15 - 250.0)
            self._put('emissivity_dial', self._dial)

    def _plate(self) -> None:
        """Scrap for the first beads."""
        self._cell.load_part('', BUILD_PLATE, -1)

    def _artefact(self) -> None:
        """The block stands on the table; its top is touched with the wire tip."""
        height, (x, y) = 1e-3 * HEIGHT_MM, (1e-3 * v for v in STANDS_MM)
        spec = GridSpec.covering(0.0, 0.0, 2 * x, 2 * y, CELL_M)
        along, across = np.meshgrid(np.abs(spec.x - x), np.abs(spec.y - y))
        slope = np.tan(np.radians(SLOPE_DEG))
        sides = [
            height - slope * (v - 0.5e-3 * t) for v, t in zip((along, across), TOP_MM, strict=True)
        ]
        self._load(HeightGrid(spec, np.clip(np.minimum(*sides), 0.0, height)))
        error = self._rng.normal(0, TOUCH_MM, 3)
        wanted = np.array([*STANDS_MM, HEIGHT_MM]) + self._look()['zero_mm'] + error
        for axis in (1, 0, 2):  # Y first: it leans
            for _ in range(2):
                self._cell.jog('xyz'[axis], float((wanted - self._torch())[axis]), 0.04)

    def _place(self) -> None:
        """The worn part, where jobs expect it."""
        nominal, worn = self._part
        goal = JobGoal(part=nominal, material=DEFAULT_MATERIAL, jobs_dir=Path('.'))
        self._load(check(goal).on_table(worn).heights)

    def _load(self, heights: HeightGrid) -> None:
        with TemporaryDirectory() as folder:
            file = Path(folder) / 'on_table.npz'
            heights.save_npz(file)
            self._cell.load_part(str(file), (0.0, 0.0, 0.0), -1)
