"""What a column can be: its quantity, the units it comes in, and the names by which others call it."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

UNITS: Mapping[str, Mapping[str, float]] = {  # quantity -> unit -> SI
    'length': {'m': 1.0, 'mm': 1e-3, 'um': 1e-6, 'in': 25.4e-3},
    'speed': {
        'm/s': 1.0, 'mm/s': 1e-3, 'm/min': 1 / 60, 'mm/min': 1e-3 / 60, 'cm/min': 1e-2 / 60, 'in/min': 25.4e-3 / 60,
    },
    'current': {'A': 1.0, 'kA': 1e3, 'mA': 1e-3},
    'voltage': {'V': 1.0, 'mV': 1e-3},
    'temperature': {'C': 1.0, 'K': 1.0, 'F': 5 / 9},
    'none': {'': 1.0},
}  # fmt: skip
OFFSETS = {'K': -273.15, 'F': -160 / 9}  # to degrees Celsius, after the factor
SPELLED = {  # other ways to write a unit
    'mmps': 'mm/s', 'mps': 'm/s', 'mpm': 'm/min', 'm_min': 'm/min', 'mm_s': 'mm/s', 'm_s': 'm/s', 'mm_min': 'mm/min',
    'ipm': 'in/min', 'mmin': 'm/min', 'degc': 'C', 'celsius': 'C', '°c': 'C', 'c': 'C', 'k': 'K', 'kelvin': 'K',
    'f': 'F', '°f': 'F', 'amp': 'A', 'amps': 'A', 'a': 'A', 'v': 'V', 'volt': 'V', 'volts': 'V', 'inch': 'in',
    'µm': 'um', 'micron': 'um', 'metres': 'm', 'meters': 'm', 'ka': 'kA', 'mv': 'mV', 'ma': 'mA',
}  # fmt: skip


@dataclass(frozen=True)
class Role:
    """What a column is. quantity: a key of UNITS. names: how others call it, small letters, `_` between words."""

    quantity: str
    words: str
    names: tuple[str, ...] = ()


ROLES: Mapping[str, Role] = {
    'position_x': Role('length', 'wire tip, work frame', ('x', 'pos_x', 'x_pos', 'tcp_x', 'position_x', 'x_position')),
    'position_y': Role('length', 'wire tip, work frame', ('y', 'pos_y', 'y_pos', 'tcp_y', 'position_y', 'y_position')),
    'position_z': Role('length', 'wire tip, work frame', ('z', 'pos_z', 'z_pos', 'tcp_z', 'position_z', 'z_position')),
    'travel_speed': Role(
        'speed', 'of the torch', ('speed', 'travel_speed', 'ts', 'tcp_speed', 'travelspeed', 'vs', 'welding_speed'),
    ),
    'wire_feed_speed': Role(
        'speed', 'of the wire, measured', ('wfs', 'wire_feed', 'wire_feed_speed', 'wirefeed', 'wire_speed', 'feed'),
    ),
    'wire_feed_commanded': Role('speed', 'of the wire, asked for', ('wfs_set', 'wire_feed_set', 'wfs_cmd', 'set_wfs')),
    'arc_current': Role('current', 'of the arc', ('i', 'current', 'arc_current', 'amperage', 'strom', 'amps')),
    'arc_voltage': Role('voltage', 'of the arc', ('u', 'voltage', 'arc_voltage', 'volts', 'spannung')),
    'arc_on': Role('none', '0 = off', ('arcon', 'arc_on', 'arc', 'welding')),
    'temperature': Role(
        'temperature', 'of a pyrometer or thermocouple', ('temp', 'temperature', 'temperatur', 'pyro',
        'tproc', 'tratio', 'twb', 'tnb'),
    ),
    'profile_x': Role('length', 'list of a profile, across'),
    'profile_height': Role('length', 'list of a profile, upwards'),
    'profile_distance': Role('length', 'list of a profile, away from the scanner'),
    'profile_intensity': Role('none', 'list of a profile'),
    'point_profile': Role('none', 'number of the profile that a point belongs to'),
    'number': Role('none', 'any number, kept on a topic of its own'),
    'ignore': Role('none', 'not imported'),
}  # fmt: skip
TELEMETRY = (
    'position_x', 'position_y', 'position_z', 'travel_speed', 'wire_feed_speed', 'wire_feed_commanded', 'arc_current',
    'arc_voltage', 'arc_on',
)  # fmt: skip
PROFILE = ('profile_x', 'profile_height', 'profile_distance', 'profile_intensity')
MANY = ('number', 'ignore', 'temperature')  # roles that several columns of a file may have
TIME_NAMES = (
    'rosbagtimestamp', 'timestamp', 'time', 'stamp', 't', '%time', 'timereceived', 'time_stamp', 'datetime',
    'date_time', 'zeit', 'date', 'secs', 'seconds', 'elapsed', 'elapsed_time',
)  # fmt: skip


def parts_of(name: str) -> tuple[str, str]:
    """Name without its unit, in small letters with `_`, and the unit ('' = none): 'Temp [°C]' is temp and C."""
    text = name.strip().strip('\ufeff')
    found = re.search(r'[\[(]\s*([^\])]*)\s*[\])]\s*$', text)
    if found and (unit := unit_of(found[1])):
        return plain(text[: found.start()]), unit
    found = re.search(r'[\s_-]([^\s_-]+(?:[_/](?:s|min))?)$', text)
    if found and len(found[1]) <= 7 and (unit := unit_of(found[1])) and found.start() > 0:
        return plain(text[: found.start()]), unit
    return plain(text), ''


def unit_of(text: str) -> str:
    """The unit as this software writes it; '' when it is none."""
    text = text.strip()
    known = {u for units in UNITS.values() for u in units if u}
    if text in known:
        return text
    lower = text.lower()
    return SPELLED.get(lower) or (lower if lower in known else '')


def plain(name: str) -> str:
    """A name for topics and comparison: small letters, digits and `_`."""
    return re.sub(r'\W+', '_', name.lower()).strip('_')


def si(value: float, quantity: str, unit: str) -> float:
    """SI; temperatures in degrees Celsius."""
    return value * UNITS[quantity][unit] + OFFSETS.get(unit, 0.0)
