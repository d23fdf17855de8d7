"""The keys of a cell file (`cell_file`): what each one means, its unit, and which parameters of which node it becomes.

One row a key, in the order of the file. Limits are those of the parameters; they stand in the nodes alone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from .operating import DEFAULT_MATERIAL

NUMBER, WHOLE, TEXT, SWITCH, PAIR, TRIPLE = (
    'a number', 'a whole number', 'text', 'true or false', 'two numbers', 'three numbers',
)  # fmt: skip
SIZES = {PAIR: 2, TRIPLE: 3}
MILLI = 1e-3
HOME = {'low': -1, 'high': 1}
AXES = 'axes.'  # what the controller is told at connect
CHUCK = 'chuck.steps_per_turn'  # what it is told by a job
MACHINE = (AXES, 'chuck.')  # how the paths of the machine's part of a file begin
BOARD, INSTRUMENT = 'bridge', 'pyrometer'  # nodes that measure the part's temperature


@dataclass(frozen=True)
class Key:
    """path: sections and name with dots; kind: of the constants above; factor: the parameter's unit over the file's;
    words: what is written for a number; example: what a new file has; given: without a # before it; simulated: a
    simulated cell is told, too."""

    path: str
    kind: str
    meaning: str
    example: str
    unit: str = ''
    parameters: tuple[tuple[str, str], ...] = ()  # node, parameter
    factor: float = 1.0
    words: dict[str, int] = field(default_factory=dict)
    given: bool = False
    simulated: bool = False

    @property
    def section(self) -> str:
        """Before the last dot."""
        return self.path.rpartition('.')[0]

    @property
    def name(self) -> str:
        """After it."""
        return self.path.rpartition('.')[2]


def _axis(axis: str, travel: str, speed: str) -> tuple[Key, ...]:
    def of(
        name: str,
        meaning: str,
        example: str,
        unit: str,
        parameter: str,
        factor: float = 1.0,
        words: dict[str, int] | None = None,
    ) -> Key:
        told = (('bridge', f'{parameter}_{axis}'),)
        kind = TEXT if words else NUMBER
        return Key(
            f'{AXES}{axis}.{name}', kind, meaning, example, unit, told, factor, words=words or {}, given=True,
            simulated=True,
        )  # fmt: skip

    last = (
        (of('accel_mm_s2', 'greatest acceleration', '300', 'mm/s2', 'max_accel', MILLI),)
        if axis == 'z'
        else (
            of(
                'accel_mm_s2',
                'what waam calibrate resonance may set at most',
                '500',
                'mm/s2',
                'accel_limit',
                MILLI,
            ),
            of(
                'home',
                'end of the axis where its switch is: low or high',
                'low',
                '',
                'home_direction',
                words=HOME,
            ),
        )
    )
    return (
        of('envelope_mm', 'travel of the axis from 0', travel, 'mm', 'envelope', MILLI),
        of('speed_mm_s', 'greatest speed', speed, 'mm/s', 'max_speed', MILLI),
        of('steps_per_mm', 'nominal; what waam calibrate finds counts while it is within 5 % of it', '320', '1/mm',
           'steps_per_mm'),
        *last,
    )  # fmt: skip


def _limit(name: str, meaning: str, example: str, unit: str, parameter: str, factor: float) -> Key:
    ends = tuple(('bridge', f'{parameter}_{end}') for end in ('min', 'max'))
    return Key(f'process.{name}', PAIR, meaning, example, unit, ends, factor, simulated=True)


def _pyrometer(
    name: str, kind: str, meaning: str, example: str, node: str, parameter: str, unit: str = ''
) -> Key:
    return Key(f'sensors.pyrometer.{name}', kind, meaning, example, unit, ((node, parameter),))


def _scanner(
    name: str,
    kind: str,
    meaning: str,
    example: str,
    parameter: str,
    unit: str = '',
    factor: float = 1.0,
) -> Key:
    return Key(
        f'sensors.scanner.{name}',
        kind,
        meaning,
        example,
        unit,
        (('scan_fusion', parameter),),
        factor,
    )


PORT, PYROMETER, MATERIAL = 'link.port', 'sensors.pyrometer.source', 'source.material'
WORK_ZERO, PLATE = 'work.zero_mm', 'work.plate_mm'
KEYS: dict[str, Key] = {
    key.path: key
    for key in (
        *_axis('x', '400', '200'), *_axis('y', '300', '200'), *_axis('z', '200', '100'),
        Key('axes.rapid_mm_s', NUMBER, 'speed of G0, along the path', '50', 'mm/s', (('bridge', 'rapid_speed'),), MILLI,
            given=True, simulated=True),
        Key('axes.home_mm_s', NUMBER, 'of homing towards a switch; slower where 3 mm would not be enough to brake',
            '40', 'mm/s', (('bridge', 'home_seek_speed'),), MILLI, given=True, simulated=True),
        Key('axes.home_latch_mm_s', NUMBER, 'of homing onto the switch', '2', 'mm/s', (('bridge', 'home_latch_speed'),),
            MILLI, given=True, simulated=True),
        Key(CHUCK, NUMBER, 'of its motor for one turn of the chuck, gear and microsteps included', '32000', '',
            (('job_sequencer', 'chuck_steps_per_turn'), ('cell', 'chuck_steps_per_turn')), simulated=True),
        Key(PORT, TEXT, 'of the controller, by its id (waam ports)', '/dev/serial/by-id/waam'),
        Key('link.baud', WHOLE, 'of a true UART; 0 = the rate that answers', '921600', 'Bd', (('bridge', 'baud'),)),
        _limit('arc_speed_mm_s', 'travel with the arc on, lowest and highest', '[3, 20]', 'mm/s', 'arc_speed', MILLI),
        _limit('wire_feed_m_min', 'wire feed, lowest and highest', '[2, 12]', 'm/min', 'wire_feed', 1 / 60),
        _limit('voltage_v', 'of the source, lowest and highest', '[12, 36]', 'V', 'voltage', 1.0),
        Key(MATERIAL, TEXT, 'wire in the feeder: key of the table of materials', DEFAULT_MATERIAL, '',
            (('thermal_compensator', 'material'),), given=True, simulated=True),
        Key(WORK_ZERO, TRIPLE, 'work zero (G54), machine coordinates', '[100, 80, 20]', 'mm',
            (('job_sequencer', 'work_offset'), ('cell', 'work_zero')), MILLI, given=True, simulated=True),
        Key(PLATE, TRIPLE, 'mode build: work zero seen from the corner of the clamped plate', '[20, 20, 10]', 'mm',
            (('job_sequencer', 'plate_zero'),), MILLI, given=True, simulated=True),
        Key(PYROMETER, TEXT, '0-10V, 4-20mA or thermocouple at the controller; serial:PORT, modbus:PORT, '
            'modbus:HOST:PORT, topic:NAME', '4-20mA'),
        _pyrometer('low_c', NUMBER, 'at 0 V, or 4 mA, at the controller', '0', BOARD, 'temperature_low', 'degC'),
        _pyrometer('high_c', NUMBER, 'at 10 V, or 20 mA (thermocouple amplifier: 3 V)', '1000', BOARD,
                   'temperature_high', 'degC'),
        _pyrometer('baud', WHOLE, 'of a serial port', '9600', INSTRUMENT, 'baud', 'Bd'),
        _pyrometer('request', TEXT, 'what is sent for a reading', r"'?T\r'", INSTRUMENT, 'request'),
        _pyrometer('pattern', TEXT, 'regular expression for a line; its first group is the number',
                   r"'!T(\d+\.\d)'", INSTRUMENT, 'pattern'),
        _pyrometer('unit', TEXT, 'of the instrument: degC, K, degF', 'degC', INSTRUMENT, 'unit'),
        _pyrometer('device', WHOLE, 'Modbus: number of the device', '1', INSTRUMENT, 'device'),
        _pyrometer('register', WHOLE, 'Modbus: address of the first register, from 0', '0', INSTRUMENT, 'register'),
        _pyrometer('register_kind', TEXT, 'Modbus: input or holding', 'input', INSTRUMENT, 'register_kind'),
        _pyrometer('register_type', TEXT, 'Modbus: int16, uint16, int32, float32, float32_swapped', 'int16', INSTRUMENT,
                   'register_type'),
        _pyrometer('scale', NUMBER, 'Modbus: unit per count', '0.1', INSTRUMENT, 'scale'),
        _pyrometer('range_low_c', NUMBER, 'lowest reading that is one', '0', INSTRUMENT, 'range_low', 'degC'),
        _pyrometer('range_high_c', NUMBER, 'highest reading that is one', '900', INSTRUMENT, 'range_high', 'degC'),
        _pyrometer('stuck_s', NUMBER, 'a reading that rests so long is stuck; an instrument of 1 K needs 60', '60',
                   'thermal_compensator', 'stuck_time', 's'),
        _scanner('points_topic', TEXT, 'of a driver with PointCloud2', 'points', 'points_topic'),
        _scanner('scan_topic', TEXT, 'of a driver with LaserScan', 'scan', 'scan_topic'),
        _scanner('frame', TEXT, 'frame_id of its profiles', 'scanner', 'scanner_frame'),
        _scanner('points_down', SWITCH, "z of its points grows away from the scanner", 'true', 'points_down'),
        _scanner('calibration', TEXT, 'file of waam scan calibrate: mounting and delay', '/path/to/scanner.yaml',
                 'calibration'),
        _scanner('mount_mm', TRIPLE, 'without a calibration: from the wire tip, work axes', '[60, 0, 120]',
                 'mount_xyz', 'mm', MILLI),
        _scanner('mount_deg', TRIPLE, 'roll, pitch, yaw', '[0, 0, 90]', 'mount_rpy', 'deg', math.pi / 180),
        _scanner('delay_ms', NUMBER, 'added to the stamps of its profiles', '0', 'profile_delay', 'ms', MILLI),
        Key('sensors.accelerometer_axes', TEXT, "axes of the accelerometer along the machine's", 'x y z', '',
            (('bridge', 'accelerometer_axes'),)),
        Key('sensors.standoff.source', TEXT, 'what the torch is held at its distance by: none, arc', 'none', '',
            (('bridge', 'standoff_source'),)),
    )
}  # fmt: skip
SECTIONS = {  # heading -> what stands above it in a new file
    'axes': 'Told to the controller at connect, read back and compared. MEASURE YOUR MACHINE: these are the values\n'
    'that a controller has when nobody tells it anything.',
    'chuck': 'Only where a chuck turns shafts in place of the X axis (simulated cells; docs/real_cell.md). x is mm of\n'
    'the unrolled shaft then: take steps_per_mm out of axes.x, and let its envelope_mm be 3500.',
    'link': 'With a port, waam up talks to a real machine (waam up --simulated: not).',
    'process': 'What the bridge refuses to go beyond, whatever a program says.',
    'source': '',
    'work': '',
    'sensors': 'Of a real cell; a simulated one has its own.',
}
