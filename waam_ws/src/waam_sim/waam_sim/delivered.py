"""The cell as it was delivered: motors, switches and sensors that are connected wrongly or are off. Lengths m.

The controller knows nothing of it. Steps per mm that are off are the virtual controller's `--machine-steps`, the wire
wheel is `arc_wire_ratio`. Home switches go by the steps that were given out, so an axis that runs the wrong way still
finds its switch here; a real one would run away from it.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np

from waam_node.params import param
from waam_robot.frames import pose_from_wpr

from .scanner import ScannerParams

GOOD = 'good'
OPEN, CLOSED = 'stuck_open', 'stuck_closed'
INPUT_ESTOP, INPUT_LIMIT = 1, 4
OUTPUT_GAS = 2
MIDDLE = np.array([0.2, 0.15, 0.1])  # machine: what turns round turns round here
TEST_VOLTAGE, TEST_CURRENT = (
    'test_voltage',
    'test_current',
)  # faults: a supply at the sensor's input


@dataclass(frozen=True)
class DeliveredParams:
    """What is wrong with the cell as it was delivered; by default nothing."""

    x_reversed: bool = param(False, 'the motor of X runs the other way')
    y_reversed: bool = param(False, 'the motor of Y runs the other way')
    z_reversed: bool = param(False, 'the motor of Z runs the other way')
    xy_swapped: bool = param(False, 'the motors of X and Y are swapped')
    skew: float = param(0.0, 'by which the y axis leans towards +x', 'deg', -5.0, 5.0)
    estop: str = param(GOOD, 'contact of the emergency stop', choices=(GOOD, 'reversed', 'unwired'))
    limits: str = param(
        GOOD, 'chain of the limit switches: good, broken wire, or bridged', choices=(GOOD, 'open', 'bridged')
    )  # fmt: skip
    gas_valve: str = param(GOOD, 'gas valve', choices=(GOOD, OPEN, CLOSED))
    current_scale: float = param(
        1.0, 'current that is read over the true one; negative = upside down', '', -2.0, 2.0
    )
    current_offset: float = 0.0  # current that is read without any [A]
    voltage_scale: float = param(1.0, 'voltage that is read over the true one', '', -2.0, 2.0)
    thermocouple_swapped: bool = param(False, 'its wires are swapped: heat reads as cold')
    scanner_x: float = param(0.0, 'by which the scanner sits beside its drawing', 'm', -0.02, 0.02)
    scanner_y: float = param(0.0, 'the same along y', 'm', -0.02, 0.02)
    scanner_z: float = param(0.0, 'the same along z', 'm', -0.02, 0.02)
    scanner_roll: float = param(0.0, 'by which it is turned about x of the work', 'deg', -5.0, 5.0)
    scanner_pitch: float = param(0.0, 'the same about y', 'deg', -5.0, 5.0)
    scanner_yaw: float = param(0.0, 'the same about z', 'deg', -5.0, 5.0)
    scanner_late: float = param(0.0, 'by which its stamps are late', 's', -0.5, 0.5)

    def mounted(self, drawn: ScannerParams) -> ScannerParams:
        """The scanner as it really sits; the same one where nothing is off."""
        angles = np.radians([self.scanner_roll, self.scanner_pitch, self.scanner_yaw])
        shift = self.scanner_x, self.scanner_y, self.scanner_z
        if not angles.any() and not any(shift):
            return drawn
        turned = pose_from_wpr(np.zeros(3), angles)[:3, :3]
        names = [f'{n}_{a}' for n in ('lateral', 'up') for a in 'xyz']
        axes = dict(zip(names, [*turned[:, 1].tolist(), *turned[:, 2].tolist()], strict=True))
        offset = {
            f'offset_{a}': getattr(drawn, f'offset_{a}') + v
            for a, v in zip('xyz', shift, strict=True)
        }
        return dataclasses.replace(drawn, **axes, **offset)

    @property
    def turns(self) -> np.ndarray:
        """(3, 3): way of the torch by commanded way."""
        signs = [-1.0 if r else 1.0 for r in (self.x_reversed, self.y_reversed, self.z_reversed)]
        turned = np.diag(signs)
        if self.xy_swapped:
            turned = turned[[1, 0, 2]]
        lean = np.eye(3)
        lean[0, 1] = math.tan(math.radians(self.skew))
        return lean @ turned

    def inputs(self, estop: bool, limit: bool) -> int:
        """Input bits of the controller. estop, limit: whether somebody presses the button, a switch."""
        pressed = {GOOD: estop, 'reversed': not estop, 'unwired': False}[self.estop]
        broken = {GOOD: limit, 'open': True, 'bridged': False}[self.limits]
        return (INPUT_ESTOP if pressed else 0) | (INPUT_LIMIT if broken else 0)

    def current(self, true: float) -> float:
        """A, as it is read."""
        return self.current_scale * true + self.current_offset

    def temperature(self, true_c: float, ambient_c: float) -> float:
        """What the thermometer is given, degrees Celsius."""
        return 2 * ambient_c - true_c if self.thermocouple_swapped else true_c


class Delivered:
    """`moved` turns what the controller gives out into what the cell does; as_ordered: it changes nothing. at_rest:
    input bits while nobody presses anything."""

    def __init__(self, params: DeliveredParams) -> None:
        self.params = params
        self.at_rest = params.inputs(False, False)
        self._turns = params.turns
        self.as_ordered = np.array_equal(self._turns, np.eye(3)) and params.gas_valve != OPEN

    def moved(self, samples: np.ndarray) -> np.ndarray:
        """Samples (n,) of SAMPLE as torch, table and valve really go; the same array where nothing is wrong."""
        if self.as_ordered:
            return samples
        out = samples.copy()
        way = np.stack([-samples['table_x'], -samples['table_y'], samples['tool_z']], axis=1)
        at = MIDDLE + (way - MIDDLE) @ self._turns.T
        out['table_x'], out['table_y'], out['tool_z'] = -at[:, 0], -at[:, 1], at[:, 2]
        if self.params.gas_valve == OPEN:
            out['outputs'] |= OUTPUT_GAS
        return out
