"""Programs for machines and people: G-code in the dialect of the controller (docs/link_protocol.md), CSV."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable

import numpy as np

from waam_plan.gcode.compact import TOLERANCE, Saving, circle, compact
from waam_plan.plan import Plan, base_feed
from waam_plan.settings import PlanSettings
from waam_process.segment import Kind, Point, Segment

LONGEST_LINE = 120  # bytes; the controller takes 160 with line number and check
CSV_COLUMNS = (
    *('index', 'kind', 'layer', 'bead', 'arc'),
    *('x0_mm', 'y0_mm', 'z0_mm', 'x1_mm', 'y1_mm', 'z1_mm'),
    *('speed_mm_s', 'height_mm', 'width_mm', 'wire_feed_m_min', 'voltage_v', 'dwell_s'),
)


def with_base_feed(segments: list[Segment], settings: PlanSettings) -> list[Segment]:
    """Deposits without setpoints get wire feed by eq 2.17 and the voltage of the settings; others are unchanged.

    Dwells with the arc on burn with the setpoints of the deposit that follows; at the end, with those of the last one.
    """
    filled = [
        s.at(wire_feed_speed=base_feed(s, settings), voltage=settings.voltage)
        if s.kind == Kind.DEPOSIT and s.wire_feed_speed == 0
        else s
        for s in segments
    ]
    return _handed_on(_handed_on(filled[::-1])[::-1])


def _handed_on(segments: list[Segment]) -> list[Segment]:
    """Segments without wire feed take feed and voltage of the one before, while the arc stays on."""
    out: list[Segment] = []
    last: Segment | None = None
    for s in segments:
        if s.arc and s.wire_feed_speed == 0 and last is not None:
            s = s.at(wire_feed_speed=last.wire_feed_speed, voltage=last.voltage)
        last = s if s.arc and s.wire_feed_speed > 0 else None
        out.append(s)
    return out


def gcode(program: Plan | list[Segment], settings: PlanSettings | None = None) -> str:
    """Program in mm, mm/min and V. W is the wire feed speed, a velocity of its own; arc on is M3, off M5.

    Segments without setpoints get those of the settings (a plan's own by default), so that the program can run
    without correction. The first move lifts to the height of the first point, then travels. Planned moves are G1,
    with the arc off too: the controller takes no speed for G0, which is left for the way to the first point.
    """
    if isinstance(program, Plan):
        settings = settings or program.settings
        segments = [s for layer in program.layers for s in layer.segments]
        head = _header(program)
    else:
        segments, head = list(program), [f'; {len(program)} segments']
    moves = ((s, None) for s in with_base_feed(segments, settings or PlanSettings()))
    return _text(head, moves)


def compact_gcode(plan: Plan, tolerance: float = TOLERANCE) -> tuple[str, Saving]:
    """The same program with long lines and arcs (G2, G3) within `tolerance` (m) of the path; its moves, counted.

    Idle moves keep the pieces of the harmonic law. There are no subprograms: equal layers are written one by one.
    """
    segments = [s for layer in plan.layers for s in layer.segments]
    moves = compact(with_base_feed(segments, plan.settings), tolerance)
    text = _text([*_header(plan), 'G17 ; arcs in XY'], ((m.segment, m.via) for m in moves))
    return text, Saving(len(segments), len(moves))


def _text(head: list[str], moves: Iterable[tuple[Segment, Point | None]]) -> str:
    """moves: each with its via point, None for a line."""
    out = [*head, 'G21 ; mm', 'G90 ; absolute', 'G54 ; work zero']
    return '\n'.join([*out, *_moves(moves), 'M30', ''])


def _header(plan: Plan) -> list[str]:
    s = plan.settings
    lines = [
        f'WAAM program: {plan.name}, {plan.mode}, {len(plan.layers)} layers',
        f'layer {s.layer_height * 1e3:g} mm, bead {s.bead_width * 1e3:g} mm, pitch {s.pitch * 1e3:.3g} mm, '
        f'travel {s.speed * 1e3:g} mm/s',
        f'{plan.beads} beads, {plan.arc_starts} arc starts, {plan.length:.2f} m of bead, {plan.wire:.1f} m of wire '
        f'{s.wire_diameter * 1e3:g} mm',
        f'about {plan.duration / 60:.1f} min without cooling and scans',
        *plan.warnings,
    ]
    return [f'; {_plain(text)[: LONGEST_LINE - 2]}' for text in lines]


def _plain(text: str) -> str:
    return text.encode('ascii', 'replace').decode().replace('\n', ' ')


def _moves(moves: Iterable[tuple[Segment, Point | None]]) -> list[str]:
    out: list[str] = []
    arc, layer, setpoint, here = False, -1, (0.0, 0.0), None
    for s, via in moves:
        if s.layer != layer:
            layer = s.layer
            out.append(f'; layer {layer}')
        if arc and not s.arc:
            out.append('M5')
            arc = False
        if here is None or math.dist(here, s.start) > 1e-6:
            out.extend(_jump(s))
        if s.arc and (s.wire_feed_speed, s.voltage) != setpoint:
            setpoint = (s.wire_feed_speed, s.voltage)
            out.append(f'W{s.wire_feed_speed * 60e3:.1f} S{s.voltage:.2f}')
        if s.arc and not arc:
            out.append('M3')
            arc = True
        out.append(_move(s, via))
        here = s.end
    if arc:
        out.append('M5')
    return out


def _jump(s: Segment) -> list[str]:
    """To the start of a segment that does not follow from the one before: height first."""
    x, y, z = (f'{v * 1e3:.3f}' for v in s.start)
    return [f'G0 Z{z}', f'G0 X{x} Y{y}']


def _move(s: Segment, via: Point | None) -> str:
    if s.kind == Kind.DWELL:
        return f'G4 P{s.dwell:.3f}'
    x, y, z = (v * 1e3 for v in s.end)
    word, centre = _arc(s, via) if via else ('G1', '')
    return f'{word} X{x:.3f} Y{y:.3f} Z{z:.3f}{centre} F{s.speed * 60e3:.1f}'


def _arc(s: Segment, via: Point) -> tuple[str, str]:
    """Word of the arc through `via` (all at one height), and its centre as seen from the start."""
    a, m, b = (np.array(p) for p in (s.start, via, s.end))
    i, j = (circle(a, m, b)[0] - a)[:2] * 1e3
    word = 'G3' if np.cross(m - a, b - a)[2] > 0 else 'G2'
    return word, f' I{i:.4f} J{j:.4f}'


def to_csv(program: Plan | list[Segment]) -> str:
    """One line per segment with a header; units are in the names of the columns."""
    segments = (
        [s for layer in program.layers for s in layer.segments]
        if isinstance(program, Plan)
        else program
    )
    out = io.StringIO()
    writer = csv.writer(out, lineterminator='\n')
    writer.writerow(CSV_COLUMNS)
    for s in segments:
        lengths = [f'{v * 1e3:.4f}' for v in (*s.start, *s.end)]
        process = [f'{s.speed * 1e3:.3f}', f'{s.height * 1e3:.4f}', f'{s.width * 1e3:.4f}']
        feed = [f'{s.wire_feed_speed * 60:.4f}', f'{s.voltage:.2f}', f'{s.dwell:.3f}']
        writer.writerow(
            [s.index, s.kind.name, s.layer, s.bead, int(s.arc), *lengths, *process, *feed]
        )
    return out.getvalue()
