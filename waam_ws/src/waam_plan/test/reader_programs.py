"""Cases of G-code: what is meant is read, what printers and CNC machines read otherwise is told or refused by line."""

from __future__ import annotations

from collections.abc import Callable
from functools import reduce
from typing import Any

from reader_case import Case

WAAM = 'G21 G90\nG0 Z5\nG0 X0 Y0\nG1 Z0 F600\nW6000 S22\nM3\n'
WIRE = 50 * 0.1 / 0.01  # mm of wire for 50 mm at 6 m/min and 10 mm/s


def rows(count: int = 10, relative: bool = True, feed: str = 'F600', e: float = 500.0) -> str:
    """Beads of 50 mm, 4 mm apart."""
    out = ['G1 Z2 F3000']
    for i in range(count):
        x0, x1 = (0, 50) if i % 2 == 0 else (50, 0)
        fed = e if relative else e * (i + 1)
        out += [f'G1 X{x0} Y{4 * i} F3000', f'G1 X{x1} Y{4 * i} E{fed:g} {feed}']
    return '\n'.join(out) + '\n'


def lays(beads: int, wire: float | None = None, length: float = 0.05) -> Callable[[Any], None]:
    """Moves with the arc on, and mm of wire of all of them."""

    def check(program: Any) -> None:
        burning = program.burning
        assert len(burning) == beads, f'{len(burning)} beads, not {beads}'
        assert all(abs(m.length - length) < 1e-6 for m in burning), burning[0].length
        if wire is not None:
            fed = sum(m.wire * m.length / m.speed for m in burning) * 1e3
            assert abs(fed - wire) < 1e-3 * wire, f'{fed} mm of wire, not {wire}'

    return check


def checked(line: str) -> str:
    return f'{line}*{reduce(lambda a, b: a ^ b, line.encode(), 0)}\n'


def printer(
    about: str,
    text: str | bytes,
    words: tuple[str, ...] = (),
    *,
    wire: float = 5000,
    beads: int = 10,
) -> Case:
    data = text if isinstance(text, bytes) else text.encode()
    return Case(about, 'extruder.gcode', lambda: data, words, check=lays(beads, wire))


def refused(about: str, text: str, *words: str, name: str = 'extruder.gcode') -> Case:
    return Case(about, name, lambda: text.encode(), words, True)


def ours(
    about: str, text: str | bytes, words: tuple[str, ...] = (), beads: int = 1, length: float = 0.05
) -> Case:
    data = text if isinstance(text, bytes) else text.encode()
    return Case(about, 'a.gcode', lambda: data, words, check=lays(beads, length=length))


HEAD = 'G21\nG90\nM83\nG28\n'
PRINTERS = [
    printer('M83, then G90', 'M83\nG90\nG21\nG28\n' + rows(), ('G90 after M83',)),
    printer('G90, then M83', HEAD + rows()),
    printer('M82', 'G90\nM82\nG28\nG92 E0\n' + rows(relative=False)),
    printer('E as G90 has it', 'G90\nG28\nG92 E0\n' + rows(relative=False)),
    printer('G91 and back', HEAD + 'G91\nG1 Z3 F600\nG90\n' + rows(), ('G90 after M83',)),
    refused(
        'relative E read as absolute',
        'G90\nM82\nG28\nG92 E0\n' + rows(),
        '9 of 10 moves that name E lay nothing',
        'line 9',
        'M83',
    ),
    printer(
        'some moves name E and lay nothing',
        HEAD + rows(12).replace('Y4 E500', 'Y4 E0').replace('Y8 E500', 'Y8 E0'),
        ('2 of 12 moves that name E lay nothing', 'line 9'),
    ),
    printer(
        'wipes', HEAD + rows().replace('F600\n', 'F600\nG1 X25 E-1 F600\nG1 X25 E1\n'), wire=5000
    ),
    printer(
        'F6 for F600',
        HEAD + rows(feed='F6'),
        ('line 7', 'at 6 mm/min is implausibly low', '10 moves, 5000 s'),
    ),
    printer('F60000 for F600', HEAD + rows(feed='F60000'), ('line 7', 'implausibly high')),
    printer('G28 W', 'G21\nG90\nM83\nG28 W\n' + rows(), ('G28 is left to the job',)),
    printer('G28 X Y', 'G21\nG90\nM83\nG28\nG1 Z9 F300\nG28 X Y\n' + rows()),
    refused('G28 with a word that is not known', 'G21\nG28 Q\n' + rows(), 'line 2', 'Q'),
    printer('M221', HEAD + 'M221 S50\n' + rows(), ('M221', '50 %'), wire=2500),
    printer('M220', HEAD + 'M220 S80\n' + rows(), ('M220', '80 %')),
    printer('M221 S100', HEAD + 'M221 S100\nM220 S100\n' + rows()),
    refused('M221 without S', HEAD + 'M221 T1\n' + rows(), 'line 5', 'M221'),
    printer('a quoted word', 'M862.3 P "MK3S" ; model\n' + HEAD + rows()),
    refused('a move behind a tool', HEAD + 'T0 G1 X10\n' + rows(), 'line 5: G1', 'passed over'),
    refused('another tool', HEAD + 'T1\n' + rows(), 'line 5: T1'),
    refused('a work zero that moves', HEAD + 'G10 L2 P1 X5\n' + rows(), 'line 5: G10'),
    printer('G10 of a temperature', HEAD + 'G10 P0 S210\n' + rows()),
    printer(
        'macros and other letters',
        ('EXCLUDE_OBJECT_START NAME=Куб_1\n' + HEAD + '; слой 1\n' + rows()).encode(),
    ),
    printer('other letters in cp1251', (HEAD + '; слой 1\n' + rows()).encode('cp1251')),
    refused(
        'a macro that is not known',
        'SET_GCODE_OFFSET Z=1\n' + HEAD + rows(),
        'line 1: SET_GCODE_OFFSET',
    ),
    printer('UTF-16', (HEAD + rows()).encode('utf-16')),
    printer('a byte order mark', (HEAD + rows()).encode('utf-8-sig')),
    printer('CR alone', (HEAD + rows()).replace('\n', '\r')),
    printer('a line separator in a comment', HEAD + '; a\u2028G92 E7\n; b\x0cG1 X1\n' + rows()),
    refused(
        'decimal commas', HEAD + rows().replace('Y4 ', 'Y4,0 '), 'line', "'4,0' has a decimal comma"
    ),
    refused('a filament change', HEAD + rows() + 'M600\n', 'M600'),
]
OURS = [
    ours('a bead', f'{WAAM}G1 X50 F600\nM5'),
    ours(
        'small letters, numbers and check sums',
        ''.join(
            checked(f'n{i} {t}') for i, t in enumerate(f'{WAAM}g1x50f600\nm5'.lower().split('\n'))
        ),
    ),
    ours('comments of both kinds', f'%\n(a ; b) {WAAM}G1 X50 (half; way) F600 ; on (and on\nM5\n%'),
    ours('inches', f'{WAAM}G20\nG1 X{50 / 25.4:.7f} F{600 / 25.4:.6f}\nM5'),
    ours('an absolute centre', f'{WAAM}G90.1\nG2 X20 Y0 I10 J0 F600\nM5', length=0.0314159265),
    ours('a relative centre in G91', f'{WAAM}G91\nG3 X20 I10 F600\nG90\nM5', length=0.0314159265),
    ours('G92', f'{WAAM}G92 X100\nG1 X150 F600\nM5'),
    ours('what follows the end', f'{WAAM}G1 X50 F600\nM5\nM30\nG0 X9', ('not read', 'line 10')),
    refused(
        'another work zero',
        f'G56\n{WAAM}G1 X50\nM5',
        'line 1: G56',
        'one work zero',
        name='a.gcode',
    ),
    refused('a wrong check sum', 'N1 G0 X1*99', 'line 1', 'check sum', name='a.gcode'),
    refused('a word without meaning', f'{WAAM}G1 X50 Q3\nM5', 'line 7: Q3', name='a.gcode'),
    refused('a flag that is no number', f'{WAAM}M5\nG28 X Y', 'line 8: X', name='a.gcode'),
    refused(
        'a decimal comma',
        f'{WAAM}G1 X50,5\nM5',
        "line 7",
        "'50,5' has a decimal comma",
        name='a.gcode',
    ),
    refused('a parameter', f'#1=5\n{WAAM}', 'line 1: #1=5', name='a.gcode'),
    refused(
        'F6 for F600',
        f'{WAAM}G1 X50 F6\nM5',
        'line 7',
        '6 mm/min is implausibly low',
        '500 s',
        name='a.gcode',
    ),
]
CASES = [*PRINTERS, *OURS]
