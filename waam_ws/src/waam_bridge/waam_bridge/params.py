"""Parameters of the bridge, in one place."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial

from waam_node.params import ParameterError, param
from waam_process.names import STANDOFF_LAWS, STANDOFF_SOURCES, TEMPERATURE_INPUTS
from waam_process.units import mm

from .mounting import mounting
from .program import Limits

OF_SOURCE = 'NaN = what fits the source'
OF_BOARD = 'NaN = as in the controller'
NAN = math.nan
WINDOW = 2048  # bytes: the controller's buffer
_standoff = partial(param, changeable=True)


@dataclass(frozen=True)
class CommonParams:
    """What the bridge of any machine has; defaults fit a cell with 1.2 mm steel wire and a 5 kW source."""

    port: str = param('/dev/serial/by-id/waam', 'serial port or pseudo-terminal of the controller')
    stop_socket: str = param(
        '', 'Unix socket for STOP and HOLD past everything (waam_node.stop_socket); empty = none'
    )
    telemetry_rate: float = param(
        100.0, 'frames per second of controller time that the controller sends', 'Hz', 10.0, 1000.0
    )
    speed_max: float = param(0.5, 'highest speed with the arc off', 'm/s', 0.001, 2.0)
    arc_speed_min: float = param(0.003, 'lowest travel speed with the arc on', 'm/s', 1e-4, 0.1)
    arc_speed_max: float = param(0.020, 'highest travel speed with the arc on', 'm/s', 1e-4, 0.1)
    wire_feed_min: float = param(2 / 60, 'lowest wire feed speed (2 m/min)', 'm/s', 0.0, 0.5)
    wire_feed_max: float = param(12 / 60, 'highest wire feed speed (12 m/min)', 'm/s', 0.0, 0.5)
    voltage_min: float = param(12.0, 'lowest voltage of the source', 'V', 0.0, 100.0)
    voltage_max: float = param(36.0, 'highest voltage of the source', 'V', 0.0, 100.0)
    csv_log: str = param('', "file of the operator's CSV log; empty = none")
    accelerometer_axes = 'x y z'  # no parameter here: only a board has the sensor

    def __post_init__(self) -> None:
        for name in ('arc_speed', 'wire_feed', 'voltage'):
            low, high = getattr(self, f'{name}_min'), getattr(self, f'{name}_max')
            if low > high:
                text = f"parameter '{name}_min' is {low:g}, above '{name}_max' {high:g}"
                raise ParameterError(text)

    @property
    def window(self) -> int:
        """Most bytes under way to the controller, within its buffer: an override waits behind them."""
        return WINDOW

    def limits(self, box_mm: tuple[float, ...]) -> Limits:
        """With the limits of the axes as the controller reported them: x0, y0, z0, x1, y1, z1, mm, machine."""
        x0, y0, z0, x1, y1, z1 = (mm(v) for v in box_mm)
        return Limits(
            low=(x0, y0, z0),
            high=(x1, y1, z1),
            speed_max=self.speed_max,
            arc_speed=(self.arc_speed_min, self.arc_speed_max),
            wire_feed_speed=(self.wire_feed_min, self.wire_feed_max),
            voltage=(self.voltage_min, self.voltage_max),
        )


@dataclass(frozen=True)
class BridgeParams(CommonParams):
    """Those of the gantry and its controller board, which a cable joins: a robot has none of them."""

    baud: int = param(
        921600,
        'rate of a true UART, 0 = the one that answers; USB-CDC and pseudo-terminals ignore it',
        'Bd',
    )
    accelerometer_axes: str = param(
        'x y z',
        "axes of the accelerometer that lie along x, y and z of the machine, such as '-y x z'",
    )
    standoff_source: str = _standoff(
        'none', 'what the torch is held at its distance by', choices=STANDOFF_SOURCES
    )
    standoff_law: str = _standoff('pid', 'from the error to the speed', choices=STANDOFF_LAWS)
    standoff_set: float = _standoff(
        NAN,
        'distance to hold, from the sensor to the metal; by the arc: contact distance; '
        + OF_SOURCE,
        'm',
        0.005,
        0.4,
    )
    standoff_dead_band: float = _standoff(
        NAN, f'error that moves nothing; {OF_SOURCE}', 'm', 0.0, 2e-3
    )
    standoff_up: float = _standoff(
        0.006, 'greatest correction of the programmed z upwards', 'm', 0.0, 0.02
    )
    standoff_down: float = _standoff(0.004, 'and downwards', 'm', 0.0, 0.02)
    standoff_rate: float = _standoff(0.006, 'greatest speed of the correction', 'm/s', 5e-5, 0.02)
    standoff_lead: float = _standoff(
        NAN, f'along the path from the arc to where the sensor looks; {OF_SOURCE}', 'm', 0.0, 0.015
    )
    standoff_jump: float = _standoff(
        NAN, f'change of the distance that must last to be believed; {OF_SOURCE}', 'm', 5e-5, 0.05
    )
    standoff_kp: float = _standoff(NAN, f'speed per error; {OF_SOURCE}', '1/s', 0.0, 50.0)
    standoff_ki: float = _standoff(
        NAN, f'speed per error and time; {OF_SOURCE}', '1/s^2', 0.0, 200.0
    )
    standoff_cross: float = _standoff(
        0.005,
        'most that the distance may contradict the current of the arc; 0 = not compared',
        'm',
        0.0,
        0.02,
    )
    standoff_arc_wander: float = _standoff(
        0.0,
        'by the arc: sigma of a contact tip and wire that wander, as a distance; 0 = steady',
        'm',
        0.0,
        5e-3,
    )
    envelope_x: float = param(NAN, f'travel of the axis from 0; {OF_BOARD}', 'm', 0.05, 3.5)
    envelope_y: float = param(NAN, f'of this axis; {OF_BOARD}', 'm', 0.05, 3.5)
    envelope_z: float = param(NAN, f'of this axis; {OF_BOARD}', 'm', 0.05, 3.5)
    max_speed_x: float = param(NAN, f'greatest speed of the axis; {OF_BOARD}', 'm/s', 0.01, 0.5)
    max_speed_y: float = param(NAN, f'of this axis; {OF_BOARD}', 'm/s', 0.01, 0.5)
    max_speed_z: float = param(NAN, f'of this axis; {OF_BOARD}', 'm/s', 0.01, 0.5)
    rapid_speed: float = param(NAN, f'of G0, along the path; {OF_BOARD}', 'm/s', 0.01, 0.5)
    max_accel_z: float = param(
        NAN,
        f'greatest acceleration of Z (of X and Y: waam calibrate); {OF_BOARD}',
        'm/s^2',
        0.05,
        5.0,
    )
    accel_limit_x: float = param(
        NAN, f'what waam calibrate may set for the axis at most; {OF_BOARD}', 'm/s^2', 0.05, 5.0
    )
    accel_limit_y: float = param(NAN, f'of this axis; {OF_BOARD}', 'm/s^2', 0.05, 5.0)
    home_seek_speed: float = param(
        NAN,
        f'of homing towards the switch, where 3 mm are enough to brake; {OF_BOARD}',
        'm/s',
        0.005,
        0.1,
    )
    home_latch_speed: float = param(
        NAN, f'of homing onto the switch; {OF_BOARD}', 'm/s', 0.0005, 0.005
    )
    home_direction_x: int = param(
        0,
        "-1: home switch at the axis' lower end, 1: at the upper; 0 = as in the controller",
        '',
        -1,
        1,
    )
    home_direction_y: int = param(0, 'of this axis', '', -1, 1)
    steps_per_mm_x: float = param(
        NAN,
        f'nominal; calibrated ones within 5 % of it stay; {OF_BOARD}',
        '1/mm',
        10.0,
        2000.0,
    )
    steps_per_mm_y: float = param(NAN, f'of this axis; {OF_BOARD}', '1/mm', 10.0, 2000.0)
    steps_per_mm_z: float = param(NAN, f'of this axis; {OF_BOARD}', '1/mm', 10.0, 2000.0)
    temperature_input: str = param(
        'none',
        "signal of the part's temperature at the controller; none = another node publishes it",
        choices=TEMPERATURE_INPUTS,
    )
    temperature_low: float = param(
        0.0, 'at 0 V, or 4 mA (thermocouple amplifier: 0 V)', 'degC', -273.0, 3000.0
    )
    temperature_high: float = param(
        1000.0, 'at 10 V, or 20 mA (thermocouple amplifier: 3 V)', 'degC', -273.0, 3000.0
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        try:
            mounting(self.accelerometer_axes)
        except ValueError as e:
            raise ParameterError(f"parameter 'accelerometer_axes': {e}") from None
        if not self.temperature_low < self.temperature_high:
            text = f"parameter 'temperature_high' is {self.temperature_high:g}, not above 'temperature_low'"
            raise ParameterError(text)

    @property
    def window(self) -> int:
        """As many as a UART sends in 22 ms, ten bits a byte; USB takes less than 1 ms for all."""
        return min(WINDOW, max(256, round(self.baud * 22e-4))) if self.baud else WINDOW
