"""Wire drive, arc and source: what the controller commands and what really comes out. Lengths m, times s.

The wire drive answers after a transport delay and a first-order lag. Its measuring wheel reads a few per cent too
much, so the drive keeps the commanded reading while less wire arrives (calibration error). The arc strikes some 50 to
150 ms after wire moves and gas flows, sometimes not at the first try. Its current is the one that melts the wire that
comes: it rises with the wire speed and falls with the contact-tip-to-work distance. Its voltage is the setpoint less
the drop in the cables; arc length fluctuates, which moves current and voltage in opposite directions. Magnitudes are
those of recorded runs, see the README.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from waam_node.params import param

from .compiled import jit, normal, record, state, uniform
from .variation import CURRENT, VOLTAGE, smooth


@dataclass(frozen=True)
class ArcParams:
    """Wire drive, arc and source."""

    wire_delay: float = param(0.030, 'transport delay of the wire drive', 's', 0.0, 0.25)
    wire_lag: float = param(0.065, 'time constant of the wire drive', 's', 1e-3, 1.0)
    wire_ratio: float = param(
        0.968, 'true wire speed over the reading of the measuring wheel', '', 0.5, 1.5
    )
    wheel_coast: float = 0.1  # time constant of the measuring wheel once no wire turns it [s]
    wire_quantum: float = 5e-4  # resolution of the wire speed reading [m/s]
    strike_min: float = 0.05  # shortest ignition delay [s]
    strike_max: float = 0.15  # longest ignition delay [s]
    strike_failure: float = param(
        0.02, 'probability that a strike fails and is tried again', '', 0.0, 1.0
    )
    strike_wire: float = 0.008  # wire speed below which the arc neither strikes nor burns [m/s]
    open_voltage: float = 65.0  # voltage of the source without arc [V]
    current_ref: float = param(138.0, 'current at 6.6 m/min and 15 mm', 'A', 20.0, 500.0)
    wire_ref: float = 0.110  # wire speed of that current [m/s]
    current_exponent: float = param(
        0.65, 'd ln(current) / d ln(wire speed) at the reference point', '', 0.3, 1.0
    )
    current_per_m: float = param(
        24.0, 'relative loss of current per metre of contact distance, there', '1/m', 0.0, 100.0
    )
    current_lag: float = 0.008  # time constant of the current [s]
    resistance: float = 3e-3  # of cables and contact tip [Ohm]
    length_noise: float = param(0.45, 'sigma of the voltage by arc length', 'V', 0.0, 5.0)
    length_time: float = 0.05  # correlation time of the arc length [s]
    current_noise: float = param(7.0, 'fall of current per volt of arc length', 'A/V', 0.0, 100.0)
    sensor_noise: float = param(
        1.5, 'sigma of the current reading; the voltage has a tenth of it', 'A', 0.0, 20.0
    )
    contact_max: float = 0.030  # contact distance at which the arc goes out [m]
    contact_min: float = 0.0  # contact distance at which the wire freezes to the tip; 0 = never [m]
    tip_wander: float = param(
        0.0,
        'sigma of the place in the contact tip where the wire takes its current',
        'm',
        0.0,
        5e-3,
    )
    tip_wander_time: float = 4.0  # correlation time of it [s]
    feed_wander: float = param(
        0.0, 'sigma of the wire behind the measuring wheel: diameter, slip, spool', '', 0.0, 0.2
    )
    feed_wander_time: float = 6.0  # correlation time of it [s]
    drift_current: float = param(0.0, 'sigma of the slow drift of the current', 'A', 0.0, 50.0)
    drift_voltage: float = param(0.0, 'sigma of the slow drift of the voltage', 'V', 0.0, 5.0)
    drift_correlation: float = param(-0.4, 'correlation of both drifts', '', -1.0, 1.0)
    drift_time: float = param(
        3.0, 'time with arc in which their autocorrelation falls to 1/e', 's', 0.2, 1e3
    )
    gas_delay: float = 0.03  # time from gas valve to flow switch [s]


DELAY_LINE = 256
REFERENCE_CTWD = 15e-3
# each makes another stream of random numbers from the first
WANDERS, DRIFTS = np.uint64(0x5BD1E995A53C9E37), np.uint64(0xC2B2AE3D27D4EB4F)

_STATE = (
    'slot', 'wire', 'reading', 'lit', 'strike', 'starving', 'current', 'length', 'flow', 'voltage', 'voltage_read',
    'current_read', 'starts', 'failed', 'ctwd', 'tip', 'feed', 'burnt', 'uncounted',
)  # fmt: skip
WIRE, READING, LIT, CURRENT_NOW, FLOW, VOLTAGE_NOW, VOLTAGE_READ, CURRENT_READ, CTWD, UNCOUNTED = (
    _STATE.index(n)
    for n in (
        'wire',
        'reading',
        'lit',
        'current',
        'flow',
        'voltage',
        'voltage_read',
        'current_read',
        'ctwd',
        'uncounted',
    )
)


@dataclass
class Arc:
    """State of wire drive and arc."""

    params: np.ndarray
    state: np.ndarray
    line: np.ndarray  # (256,) m/s, commands of the last milliseconds
    rng: (
        np.ndarray
    )  # (3,) random states: of the arc, of what wanders, of what drifts (that one stays)

    def __post_init__(self) -> None:
        self._values = self.state.view(np.float64)
        self._quantum = float(self.params['wire_quantum'][0])

    def value(self, number: int) -> float:
        """One value of the state, by its place in it: LIT and others of this module."""
        return self._values.item(number)

    def read_wheel(self) -> float:
        """What the measuring wheel reports, m/s, once per sample: whole counts; the rest of one is part of the next
        sample, so no wire is lost in the sum."""
        wanted = self.value(READING) + self.value(UNCOUNTED)
        counted = round(wanted / self._quantum) * self._quantum
        self._values[UNCOUNTED] = wanted - counted
        return counted

    @classmethod
    def cold(cls, params: ArcParams, rng: np.ndarray) -> Arc:
        """Wire at rest, no arc, source off. rng: of `random_state`."""
        s = state(*_STATE)
        s['strike'] = -1.0
        streams = np.array([rng[0], rng[0] ^ WANDERS, rng[0] ^ DRIFTS], np.uint64)
        return cls(record(params), s, np.zeros(DELAY_LINE), streams)


@jit
def advance_wire(p, s, line, rng, command, slip, empty, dt):
    """One sample of the drive; `slip`: share that the rolls lose (the wheel sees it); `empty`: the wire has run out, so
    nothing is fed and the wheel runs down. Sets s.wire and s.reading."""
    slot = int(s.slot)
    line[slot] = command
    delayed = line[(slot - int(p.wire_delay / dt + 0.5)) % DELAY_LINE]
    s.slot = (slot + 1) % DELAY_LINE
    if empty:
        s.reading *= max(1.0 - dt / p.wheel_coast, 0.0)
        s.wire = 0.0
        return
    drive = s.reading / max(1.0 - slip, 1e-3) if slip < 1.0 else 0.0
    drive += (delayed - drive) * min(dt / p.wire_lag, 1.0)
    s.reading = drive * (1.0 - slip)
    s.wire = s.reading * p.wire_ratio
    if p.feed_wander > 0.0:
        s.wire *= 1.0 + p.feed_wander * s.feed


@jit
def wander(value, time, rng, dt):
    """The next value of a process with zero mean, unit variance and this correlation time."""
    keep = max(1.0 - dt / time, 0.0)
    return keep * value + (1.0 - keep * keep) ** 0.5 * normal(rng)


@jit
def _change(p, s, rng, dt):
    """What changes slowly: the place of contact in the tip, the wire. Nothing is drawn where nothing wanders."""
    if p.tip_wander > 0.0:
        s.tip = wander(s.tip, p.tip_wander_time, rng, dt)
    if p.feed_wander > 0.0:
        s.feed = wander(s.feed, p.feed_wander_time, rng, dt)


@jit
def steady_current(p, wire, ctwd):
    """A, at a wire speed and a contact-tip-to-work distance. The wire melts by the heat of the arc, which goes with the
    current, and by that of its own resistance, which goes with its length and the square of the current (Lesnewich
    1958): w / w0 = (1 - s) a + s l a^2, with a the current and l the length over those at the reference point."""
    p_exponent = min(p.current_exponent, 0.999)
    share = 1.0 / p_exponent - 1.0  # s: of the melting by resistance
    linear = 2.0 - 1.0 / p_exponent
    length = max(1.0 + p.current_per_m * (ctwd - REFERENCE_CTWD) / (1.0 - p_exponent), 0.05)
    square = share * length
    ratio = max(wire, 1e-4) / p.wire_ref
    relative = (math.sqrt(linear * linear + 4.0 * square * ratio) - linear) / (2.0 * square)
    return max(p.current_ref * relative, 10.0)


@jit
def burns_at(p, ctwd):
    """Whether an arc can burn at this contact distance."""
    return ctwd < p.contact_max and (p.contact_min == 0.0 or ctwd > p.contact_min)


@jit
def _strike(p, s, rng, ready, dt):
    """Ignition: a random delay, now and then a failure and another try."""
    if not ready:
        s.strike = -1.0
    elif s.strike < 0.0:
        s.strike = p.strike_min + (p.strike_max - p.strike_min) * uniform(rng)
    else:
        s.strike -= dt
        if s.strike <= 0.0:
            if uniform(rng) < p.strike_failure:
                s.failed += 1.0
                s.strike = 2.0 * p.strike_max
            else:
                s.lit, s.starts, s.starving = 1.0, s.starts + 1.0, 0.0


@jit
def advance_arc(p, s, rng, on, gas, blocked, voltage_set, ctwd, dt):
    """One sample of the arc. `on`, `gas`: outputs; `blocked`: by a fault. Sets s.lit and the readings."""
    s.ctwd = ctwd
    s.flow += (1.0 if gas else -1.0) * dt / max(p.gas_delay, dt)
    s.flow = min(max(s.flow, 0.0), 1.0)
    fed = s.wire > p.strike_wire
    if not on or blocked:
        s.lit, s.strike = 0.0, -1.0
    elif s.lit == 0.0:
        _strike(p, s, rng, fed and s.flow >= 1.0 and burns_at(p, ctwd), dt)
    else:
        s.starving = 0.0 if fed else s.starving + dt
        if s.starving > 0.1 or not burns_at(p, ctwd):
            s.lit, s.strike = 0.0, -1.0
    _change(p, s, rng[1:], dt)
    length = ctwd + p.tip_wander * s.tip
    _electric(p, s, rng, on, voltage_set, length, dt)


@jit
def drift(p, s, key):
    """(A, V): slow drift of current and voltage, by the time that the arc has burnt, not by that of the clock."""
    if p.drift_current == 0.0 and p.drift_voltage == 0.0:
        return 0.0, 0.0
    first = smooth(key, CURRENT, s.burnt, p.drift_time)
    other = smooth(key, VOLTAGE, s.burnt, p.drift_time)
    r = p.drift_correlation
    return p.drift_current * first, p.drift_voltage * (r * first + math.sqrt(1.0 - r * r) * other)


@jit
def _electric(p, s, rng, on, voltage_set, ctwd, dt):
    """Current and voltage, and their readings."""
    keep = max(1.0 - dt / p.length_time, 0.0)
    s.length = keep * s.length + (1.0 - keep * keep) ** 0.5 * p.length_noise * normal(rng)
    if s.lit > 0.0:
        s.burnt += dt
        amperes, volts = drift(p, s, rng[2])
        target = steady_current(p, s.wire, ctwd) - p.current_noise * s.length + amperes
        s.current += (max(target, 5.0) - s.current) * min(dt / p.current_lag, 1.0)
        s.voltage = max(voltage_set - p.resistance * s.current + s.length + volts, 5.0)
        s.current_read = max(s.current + p.sensor_noise * normal(rng), 0.0)
    else:
        s.current *= max(1.0 - dt / 1e-3, 0.0)
        s.voltage = p.open_voltage if on else 0.0
        s.current_read = s.current
    s.voltage_read = s.voltage + 0.1 * p.sensor_noise * normal(rng) if s.voltage > 0.0 else 0.0
