"""Settings of a plan. SI; every field is checked and an error names it."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, fields

Triple = tuple[float, float, float]
Pair = tuple[float, float]

DIRECTIONS = ('auto', 'x', 'y')
ALTERNATIONS = ('none', 'reverse', 'cross', 'turn')
OF_BUILDS = ('compensation_height', 'shrinkage')
STRATEGIES = ('solid', 'shell', 'zigzag', 'contour', 'spiral', 'combined', 'medial')
LEVELS = ('equal', 'adaptive')
OVERHANGS = ('refuse', 'flag')
JUDGED_RIM = 1.0e-3  # m along the edge of what was laid, not judged
MAX_LAYER_RATIO = 1.4  # thickest layer over layer_height
IDLE_LAWS = ('harmonic', 'plain')


class SettingsError(ValueError):
    """Settings out of range; the text names every field, its value and limit."""


# field: (lowest, highest), both allowed
_LIMITS: dict[str, Pair] = {
    'layer_height': (0.3e-3, 5e-3),
    'bead_width': (1e-3, 20e-3),
    'pitch_ratio': (0.4, 1.0),
    'speed': (1e-3, 0.05),
    'speed_max': (1e-3, 0.05),
    'segment_length': (0.2e-3, 50e-3),
    'min_layer': (0.05, 0.95),
    'tolerance': (0.0, 5e-3),
    'finish_height': (0.0, 5e-3),
    'finish_layers': (0, 5),
    'finish_growth': (1.0, 2.0),
    'allowance': (-5e-3, 10e-3),
    'wear_limit': (1e-3, 1.0),
    'smoothing': (0.0, 2.0),
    'edge_inset': (0.0, 1.0),
    'overrun': (0.0, 10e-3),
    'pool_trail': (0.0, 20e-3),
    'start_spread': (0.0, 50e-3),
    'lead_in_metal': (0.3, 1.5),
    'lead_out_metal': (0.3, 2.0),
    'turn_deg': (0.0, 180.0),
    'contours': (1, 20),
    'edge_metal': (0.5, 1.5),
    'ring_inset': (0.1, 0.5),
    'corner_radius': (0.0, 1.0),
    'lead_on': (0.0, 10.0),
    'lead_off': (0.0, 50e-3),
    'bead_time': (0.0, 600.0),
    'base_layers': (0, 100),
    'base_speed': (0.3, 1.0),
    'cusp': (0.05e-3, 5e-3),
    'torch_radius': (0.0, 0.1),
    'idle_acceleration': (0.01, 50.0),
    'idle_speed': (1e-3, 0.5),
    'scan_speed': (1e-3, 0.5),
    'clearance': (1e-3, 0.2),
    'grid': (0.05e-3, 5e-3),
    'margin': (0.0, 0.1),
    'overhang_limit_deg': (5.0, 85.0),
    'foot_height': (0.0, 0.1),
    'growth_step': (0.0, 1e-3),
    'voltage': (5.0, 60.0),
    'scanner_fov': (1e-3, 1.0),
    'wire_diameter': (0.5e-3, 5e-3),
    'efficiency': (0.3, 1.0),
    'arc_power': (100.0, 50e3),
    'arc_efficiency': (0.1, 1.0),
    'gas_flow': (0.0, 2e-3),
    'compensation_height': (0.0, 50e-3),
    'shrinkage': (-0.05, 0.05),
    'tilt_deg': (-100.0, 100.0),
}


_ZERO_TOO = {'edge_metal', 'ring_inset'}  # 0 = as the strategy needs it

_LENGTHS = {'scanner_offset': 3, 'machine_min': 3, 'machine_max': 3, 'scanner_range': 2}

_CHOICES = {
    'direction': DIRECTIONS,
    'alternation': ALTERNATIONS,
    'strategy': STRATEGIES,
    'levels': LEVELS,
    'overhang': OVERHANGS,
    'idle_law': IDLE_LAWS,
}


@dataclass(frozen=True)
class PlanSettings:
    """Lengths in m, speeds in m/s. 'Share' and 'ratio' have no unit."""

    layer_height: float = 2.0e-3  # nominal thickness of a layer
    bead_width: float = 6.0e-3  # width of one bead
    pitch_ratio: float = 0.60  # distance of neighbouring beads over bead width
    speed: float = 0.010  # travel speed of the nominal layer
    speed_max: float = 0.018  # fastest programmed travel with the arc on; leaves room to correct
    segment_length: float = 2.0e-3  # longest segment with the arc on
    min_layer: float = 0.35  # share of layer_height below which nothing is laid
    tolerance: float = 0.0  # allowed deviation of a restored surface; 0 = no finishing layers
    finish_height: float = 0.0  # of the finishing layers of a restoration; 0 = from the tolerance
    finish_layers: int = 3  # number of finishing layers, 0 = none
    finish_growth: float = 1.0  # thickness of a finishing layer over that of the one above it
    allowance: float = 0.0  # metal wanted above nominal, for machining
    # a scan of which nearly all lies lower than this is not one of a worn part, but lies in another place
    wear_limit: float = 15e-3
    smoothing: float = 0.5  # window over which the as-found surface is smoothed, in bead widths
    edge_inset: float = 0.2  # distance of bead ends from the edge of the region, in pitches
    overrun: float = 1.0e-3  # metal laid over the free sides of the part, to be machined off
    pool_trail: float = 0.5e-3  # distance of the melt pool behind the arc
    direction: str = 'auto'  # of the beads: x, y, or auto = the longer side
    # none; reverse: even layers start opposite; cross: and turned by 90; turn: every layer by turn_deg
    alternation: str = 'reverse'
    turn_deg: float = 67.0  # between the beads of neighbouring layers, alternation turn
    contours: int = 1  # rings along the edge, strategy combined
    stagger: bool = False  # beads of every second layer lie over the valleys of the one below
    # least distance of arc starts in neighbouring layers, where possible
    start_spread: float = 5e-3
    lead_in_metal: float = 1.0  # metal in the lead-in over the planned, below 1 against humps
    lead_out_metal: float = 1.0  # metal in the lead-out over the planned, above 1 against a crater
    # metal of the beads along the edge over what the schedule gives them; 0 = as the strategy needs it
    edge_metal: float = 0.0
    # distance of the outermost ring from the edge, in bead widths; 0 = as the strategy needs it
    ring_inset: float = 0.0
    corner_radius: float = 0.0  # of rings, in bead widths; 0 = as the strategy needs it
    lead_on: float = 0.0  # s that the arc burns before the torch moves
    lead_off: float = 0.0  # last stretch of a path that is travelled without arc
    bead_time: float = 0.0  # s; after a shorter bead the torch waits for the rest of it
    base_layers: int = 1  # lowest layers of a build, laid slower on the cold substrate
    base_speed: float = 0.8  # of the nominal travel, in the base layers; the feed follows
    idle_law: str = 'harmonic'  # speeds of idle moves: harmonic, or plain = one speed
    idle_speed: float = 0.050  # fastest travel with the arc off
    idle_acceleration: float = 0.5  # m/s2, highest with the arc off
    # no metal higher than the clearance allows within this of an idle move
    torch_radius: float = 0.010
    scan_speed: float = 0.025  # travel while scanning
    clearance: float = 0.010  # height of idle moves over the highest point
    grid: float = 0.5e-3  # cell of maps made here
    margin: float = 5e-3  # scanned around the wanted rectangle
    overhang_limit_deg: float = 45.0  # steepest overhang from the vertical in a build
    overhang: str = 'refuse'  # what is steeper; flag: warn and build it
    strategy: str = 'solid'  # how layers are filled, see below; shell = one bead along the surface
    levels: str = 'equal'  # of a build; adaptive: thinner layers on slanting faces
    cusp: float = 0.8e-3  # largest step off a slanting face, adaptive layers
    foot_height: float = 0.010  # up to here above the substrate, metal is added below overhangs
    # sections of a build that differ by less are planned once and repeated
    growth_step: float = 1e-6
    scanner_offset: Triple = (0.060, 0.0, 0.120)  # origin of frame scanner from torch_tcp
    scanner_fov: float = 0.050  # width of a profile
    scanner_range: Pair = (-0.150, -0.100)  # measured z_s, lowest and highest
    machine_min: Triple = (-0.100, -0.080, -0.020)  # reach of torch_tcp in the work frame
    machine_max: Triple = (0.300, 0.220, 0.180)  # its other end
    wire_diameter: float = 1.2e-3  # of the estimate and of programs written to a file
    efficiency: float = 0.92  # metal in the bead over wire melted
    voltage: float = 22.0  # V, of a program that is written to a file
    arc_power: float = 4.0e3  # W, for the estimate of heat
    arc_efficiency: float = 0.8  # heat in the part over energy of the arc
    gas_flow: float = 2.5e-4  # m3/s of shielding gas while the arc burns (15 l/min)
    # of a build, metal below the part to be cut off; 0 = none, 10 to 15 mm where substrate and wire differ
    compensation_height: float = 0.0
    shrinkage: float = 0.0  # share by which a build shrinks when it cools; it is planned larger
    # by which a robot's positioner tilts the part towards the robot, +x up (waam_robot.tilt); 0 = level
    tilt_deg: float = 0.0
    # the tilted part is held by a clamp over level ground at the work zero, not on the faceplate
    clamp: bool = False

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
        for low, high, axis in zip(self.machine_min, self.machine_max, 'xyz', strict=True):
            if low >= high:
                wrong.append(f'machine_min {axis} is {low:g}, not below machine_max {high:g}')
        return wrong

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
    low, high = _LIMITS.get(name, (-math.inf, math.inf))
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
