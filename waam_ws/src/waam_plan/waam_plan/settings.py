"""Settings of a plan. SI; every field is checked and an error names it."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # the parser of the command line reads this module, and loads no numpy
    from waam_process.unrolled import Unrolled

Triple = tuple[float, float, float]
Pair = tuple[float, float]

DIRECTIONS = ('auto', 'x', 'y')
ALTERNATIONS = ('none', 'reverse', 'cross', 'turn')
OF_BUILDS = ('compensation_height', 'shrinkage')
STRATEGIES = ('solid', 'shell', 'zigzag', 'contour', 'spiral', 'combined', 'medial')
LEVELS = ('equal', 'adaptive')
FINISHES = ('as-laid', 'machined')
OVERHANGS = ('refuse', 'flag')
JUDGED_RIM = 1.0e-3  # m along the edge of what was laid, not judged
MAX_LAYER_RATIO = 1.4  # thickest layer over layer_height
IDLE_LAWS = ('harmonic', 'plain')


class SettingsError(ValueError):
    """Settings out of range; the text names every field, its value and limit."""


_ZERO_TOO = {'edge_metal', 'ring_inset'}  # 0 = as the strategy needs it

_LENGTHS = {'scanner_offset': 3, 'machine_min': 3, 'machine_max': 3, 'scanner_range': 2}

_CHOICES = {
    'direction': DIRECTIONS,
    'alternation': ALTERNATIONS,
    'strategy': STRATEGIES,
    'levels': LEVELS,
    'finish': FINISHES,
    'overhang': OVERHANGS,
    'idle_law': IDLE_LAWS,
}


def within(default: Any, low: float, high: float) -> Any:
    """A field with its default, lowest and highest value, both allowed."""
    return field(default=default, metadata={'range': (low, high)})


@dataclass(frozen=True)
class PlanSettings:
    """Lengths in m, speeds in m/s. 'Share' and 'ratio' have no unit."""

    layer_height: float = within(2.0e-3, 0.3e-3, 5e-3)  # nominal thickness of a layer
    bead_width: float = within(6.0e-3, 1e-3, 20e-3)  # width of one bead
    pitch_ratio: float = within(0.60, 0.4, 1.0)  # distance of neighbouring beads over bead width
    speed: float = within(0.010, 1e-3, 0.05)  # travel speed of the nominal layer
    speed_max: float = within(
        0.018, 1e-3, 0.05
    )  # fastest programmed travel with the arc on; leaves room to correct
    segment_length: float = within(2.0e-3, 0.2e-3, 50e-3)  # longest segment with the arc on
    min_layer: float = within(0.35, 0.05, 0.95)  # share of layer_height below which nothing is laid
    tolerance: float = within(
        0.0, 0.0, 5e-3
    )  # allowed deviation of a restored surface; 0 = no finishing layers
    finish_height: float = within(
        0.0, 0.0, 5e-3
    )  # of the finishing layers of a restoration; 0 = from the tolerance
    finish_layers: int = within(3, 0, 5)  # number of finishing layers, 0 = none
    finish: str = 'as-laid'  # of a restoration; machined: nothing below nominal after machining
    # metal wanted above nominal, for machining; 0 with finish machined = chosen by the forecast
    allowance: float = within(0.0, -5e-3, 10e-3)
    # a scan of which nearly all lies lower than this is not one of a worn part, but lies in another place
    wear_limit: float = within(15e-3, 1e-3, 1.0)
    smoothing: float = within(
        0.5, 0.0, 2.0
    )  # window over which the as-found surface is smoothed, in bead widths
    edge_inset: float = within(
        0.2, 0.0, 1.0
    )  # distance of bead ends from the edge of the region, in pitches
    overrun: float = within(
        1.0e-3, 0.0, 10e-3
    )  # metal laid over the free sides of the part, to be machined off
    pool_trail: float = within(0.5e-3, 0.0, 20e-3)  # distance of the melt pool behind the arc
    direction: str = 'auto'  # of the beads: x, y, or auto = the longer side
    # none; reverse: even layers start opposite; cross: and turned by 90; turn: every layer by turn_deg
    alternation: str = 'reverse'
    turn_deg: float = within(
        67.0, 0.0, 180.0
    )  # between the beads of neighbouring layers, alternation turn
    contours: int = within(1, 1, 20)  # rings along the edge, strategy combined
    stagger: bool = False  # beads of every second layer lie over the valleys of the one below
    # least distance of arc starts in neighbouring layers, where possible
    start_spread: float = within(5e-3, 0.0, 50e-3)
    lead_in_metal: float = within(
        1.0, 0.3, 1.5
    )  # metal in the lead-in over the planned, below 1 against humps
    lead_out_metal: float = within(
        1.0, 0.3, 2.0
    )  # metal in the lead-out over the planned, above 1 against a crater
    # metal of the beads along the edge over what the schedule gives them; 0 = as the strategy needs it
    edge_metal: float = within(0.0, 0.5, 1.5)
    # distance of the outermost ring from the edge, in bead widths; 0 = as the strategy needs it
    ring_inset: float = within(0.0, 0.1, 0.5)
    corner_radius: float = within(
        0.0, 0.0, 1.0
    )  # of rings, in bead widths; 0 = as the strategy needs it
    lead_on: float = within(0.0, 0.0, 10.0)  # s that the arc burns before the torch moves
    lead_off: float = within(
        0.0, 0.0, 50e-3
    )  # last stretch of a path that is travelled without arc
    bead_time: float = within(
        0.0, 0.0, 600.0
    )  # s; after a shorter bead the torch waits for the rest of it
    base_layers: int = within(
        1, 0, 100
    )  # lowest layers of a build, laid slower on the cold substrate
    base_speed: float = within(
        0.8, 0.3, 1.0
    )  # of the nominal travel, in the base layers; the feed follows
    idle_law: str = 'harmonic'  # speeds of idle moves: harmonic, or plain = one speed
    idle_speed: float = within(0.050, 1e-3, 0.5)  # fastest travel with the arc off
    idle_acceleration: float = within(0.5, 0.01, 50.0)  # m/s2, highest with the arc off
    # no metal higher than the clearance allows within this of an idle move
    torch_radius: float = within(0.010, 0.0, 0.1)
    scan_speed: float = within(0.025, 1e-3, 0.5)  # travel while scanning
    clearance: float = within(0.010, 1e-3, 0.2)  # height of idle moves over the highest point
    grid: float = within(0.5e-3, 0.05e-3, 5e-3)  # cell of maps made here
    margin: float = within(5e-3, 0.0, 0.1)  # scanned around the wanted rectangle
    overhang_limit_deg: float = within(
        45.0, 5.0, 85.0
    )  # steepest overhang from the vertical in a build
    overhang: str = 'refuse'  # what is steeper; flag: warn and build it
    strategy: str = 'solid'  # how layers are filled, see below; shell = one bead along the surface
    levels: str = 'equal'  # of a build; adaptive: thinner layers on slanting faces
    cusp: float = within(0.8e-3, 0.05e-3, 5e-3)  # largest step off a slanting face, adaptive layers
    foot_height: float = within(
        0.010, 0.0, 0.1
    )  # up to here above the substrate, metal is added below overhangs
    scanner_offset: Triple = (0.060, 0.0, 0.120)  # origin of frame scanner from torch_tcp
    scanner_fov: float = within(0.050, 1e-3, 1.0)  # width of a profile
    scanner_range: Pair = (-0.150, -0.100)  # measured z_s, lowest and highest
    machine_min: Triple = (-0.100, -0.080, -0.020)  # reach of torch_tcp in the work frame
    machine_max: Triple = (0.300, 0.220, 0.180)  # its other end
    wire_diameter: float = within(
        1.2e-3, 0.5e-3, 5e-3
    )  # of the estimate and of programs written to a file
    efficiency: float = within(0.92, 0.3, 1.0)  # metal in the bead over wire melted
    voltage: float = within(22.0, 5.0, 60.0)  # V, of a program that is written to a file
    arc_power: float = within(4.0e3, 100.0, 50e3)  # W, for the estimate of heat
    arc_efficiency: float = within(0.8, 0.1, 1.0)  # heat in the part over energy of the arc
    gas_flow: float = within(
        2.5e-4, 0.0, 2e-3
    )  # m3/s of shielding gas while the arc burns (15 l/min)
    # of a build, metal below the part to be cut off; 0 = none, 10 to 15 mm where substrate and wire differ
    compensation_height: float = within(0.0, 0.0, 50e-3)
    shrinkage: float = within(
        0.0, -0.05, 0.05
    )  # share by which a build shrinks when it cools; it is planned larger
    # by which a robot's positioner tilts the part towards the robot, +x up (waam_robot.tilt); 0 = level
    tilt_deg: float = within(0.0, -100.0, 100.0)
    # the tilted part is held by a clamp over level ground at the work zero, not on the faceplate
    clamp: bool = False
    # nominal diameter of a shaft that turns in place of the X axis (waam_process.unrolled); 0 = the part lies still
    shaft_diameter: float = within(0.0, 0.0, 0.5)
    shaft_ends: float = within(0.0, 0.0, 0.5)  # of the shaft that are unworn at each end

    def __post_init__(self) -> None:
        wrong = [p for f in fields(self) if (p := _problem(f.name, getattr(self, f.name)))]
        wrong = wrong or self._contradictions()
        if wrong:
            raise SettingsError('; '.join(wrong))

    def _contradictions(self) -> list[str]:
        """Between fields that are right by themselves."""
        wrong = []
        if self.speed_max < self.speed:
            wrong.append(f'speed_max is {self.speed_max:g}, below speed {self.speed:g}')
        if self.scanner_range[0] >= self.scanner_range[1]:
            wrong.append(f'scanner_range {self.scanner_range} must be (lowest, highest)')
        if self.clamp and not self.tilt_deg:
            wrong.append('clamp belongs to a tilt (tilt_deg)')
        wrong += self._of_shaft()
        for low, high, axis in zip(self.machine_min, self.machine_max, 'xyz', strict=True):
            if low >= high:
                wrong.append(f'machine_min {axis} is {low:g}, not below machine_max {high:g}')
        return wrong

    def _of_shaft(self) -> list[str]:
        """What does not go together with a shaft, or only with one."""
        if not self.shaft_diameter:
            return ['shaft_ends belongs to a shaft (shaft_diameter)'] if self.shaft_ends else []
        from waam_process.unrolled import THINNEST

        wrong = []
        if self.shaft_diameter < THINNEST:
            wrong.append(
                f'shaft_diameter is {self.shaft_diameter:g}, thinner than {THINNEST:g} m is not planned'
            )
        fixed = {
            'strategy': ('solid', 'zigzag'), 'direction': DIRECTIONS, 'alternation': ('none', 'reverse'),
            'tilt_deg': (0,), 'stagger': (False,),
        }  # fmt: skip
        for name, known in fixed.items():
            if (value := getattr(self, name)) not in known:
                wrong.append(
                    f'{name} is {value}: a shaft is laid around (strategy solid) or in lines along its axis (zigzag), '
                    'nothing else is built'
                )
        return wrong + [
            f'{name}: only a build knows this, a shaft is restored' for name in self.of_builds()
        ]

    @property
    def unrolled(self) -> Unrolled | None:
        """The shaft; None for a part that lies still."""
        if not self.shaft_diameter:
            return None
        from waam_process.unrolled import Unrolled

        return Unrolled(self.shaft_diameter)

    def of_builds(self) -> list[str]:
        """Fields that are set and that only a build knows."""
        return [n for n in OF_BUILDS if getattr(self, n) != getattr(PlanSettings, n)]

    @property
    def pitch(self) -> float:
        """Distance of neighbouring beads, m."""
        return self.pitch_ratio * self.bead_width

    @property
    def edge_share(self) -> float:
        """Metal of the beads along the edge over what the division gives them."""
        return self.edge_metal or 1.0

    @property
    def first_ring(self) -> float:
        """Distance of the outermost ring from the edge, m."""
        return (self.ring_inset or 0.5) * self.bead_width

    @property
    def wire_area(self) -> float:
        """Section of the wire, m2."""
        return math.pi * self.wire_diameter**2 / 4


_RANGES: dict[str, Pair] = {f.name: f.metadata['range'] for f in fields(PlanSettings) if f.metadata}


def _problem(name: str, value: object) -> str:
    """What is wrong with one field by itself, '' when nothing is."""
    if name in _CHOICES:
        allowed = _CHOICES[name]
        return (
            '' if value in allowed else f'{name} is {value!r}, must be one of {", ".join(allowed)}'
        )
    if name in _LENGTHS and (not isinstance(value, tuple) or len(value) != _LENGTHS[name]):
        return f'{name} is {value!r}, must be {_LENGTHS[name]} numbers'
    for v in value if isinstance(value, tuple) else (value,):
        if not isinstance(v, (int, float)) or not math.isfinite(v):
            return f'{name} is {value!r}, not a finite number'
    if name in _ZERO_TOO and value == 0:
        return ''
    low, high = _RANGES.get(name, (-math.inf, math.inf))
    if isinstance(value, (int, float)) and not low <= value <= high:
        return f'{name} is {value:g}, must be between {low:g} and {high:g}'
    return ''


def assigned(texts: Iterable[str], elsewhere: Iterable[str] = ()) -> dict[str, object]:
    """{field: value} of texts 'NAME=VALUE' (SI). elsewhere: fields with an option of their own, refused here.

    Raises SettingsError with everything that is wrong.
    """
    kinds = {f.name: type(f.default) for f in fields(PlanSettings) if f.name not in set(elsewhere)}
    given: dict[str, object] = {}
    wrong, unknown = [], False
    for text in texts:
        name, equals, value = text.partition('=')
        if not equals:
            wrong.append(f'{text}: not of the form NAME=VALUE')
        elif name in elsewhere:
            wrong.append(f'{text}: {name} is given by the goal or the machine, not as a setting')
        elif name not in kinds:
            unknown = True
            wrong.append(f'{text}: there is no setting {name}')
        else:
            given[name] = _value(value, kinds[name])
            told = given[name] is None and f'{value!r} is not a {kinds[name].__name__}'
            if told := told or _problem(name, given[name]):
                wrong.append(f'{text}: {told}')
    if unknown:
        wrong.append(f'known: {", ".join(kinds)}')
    if wrong:
        raise SettingsError('; '.join(wrong))
    return given


def _value(text: str, kind: type) -> object:
    """None when the text is no value of this kind."""
    try:
        if kind is bool:
            return {'true': True, 'false': False}[text.lower()]
        if kind is tuple:
            return tuple(float(v) for v in text.split(','))
        return kind(text)
    except (ValueError, KeyError):
        return None
