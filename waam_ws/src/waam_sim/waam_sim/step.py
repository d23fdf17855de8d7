"""The compiled loops of the cell: it lives through the samples of the controller, and exposes profiles on the way.

Lengths m, times s, temperatures degrees Celsius; records and states are those of the parts that they belong to.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from .arc import REFERENCE_CTWD, advance_arc, advance_wire
from .compiled import SOURCES, bilinear, jit
from .heat import add_arc, conduct, grow
from .metal import advance as advance_metal
from .metal_film import advance as advance_film
from .metal_models import FILM, SECTIONS
from .metal_sections import advance as advance_sections
from .placement import distort, rise, warm
from .pool import under_wire
from .scanner import profile
from .variation import arriving, beside, pass_path, spatter, strike

AHEAD = 8e-3  # where the temperature that the bead meets is taken, ahead of the arc


def _make_live(sources: int) -> Callable:
    @jit
    def live(
        zero, last, z, solid, touched, mp, ms, skin, bulk, thickness, hp, hs, ap, als, line, rng, values, hot, kept,
        lp, ls, vp, vs, key, samples, now, blocked, gas_out, slip, empty, model,
    ):  # fmt: skip
        if not sources:
            return
        m, mstate, h, hstate, a, astate = mp[0], ms[0], hp[0], hs[0], ap[0], als[0]
        placed, placed_state, vary, varied = lp[0], ls[0], vp[0], vs[0]
        n = samples.size
        dt = 1e-3
        for i in range(n):
            x = -samples[i].table_x - zero[0]
            y = -samples[i].table_y - zero[1]
            height = samples[i].tool_z - zero[2]
            on = samples[i].outputs & 1 != 0
            gas = samples[i].outputs & 2 != 0 and not gas_out
            time = now - (n - 1 - i) * dt
            last[0], last[1], last[2] = x, y, height
            path, idle, was_lit = varied.path, varied.idle, astate.lit > 0.0
            pass_path(varied, x, y, was_lit, dt)
            if on:
                aside_x, aside_y = beside(vary, varied, key)
                x, y = x + aside_x, y + aside_y
            advance_wire(a, astate, line, rng, samples[i].wire_cmd, slip, empty, dt)
            if astate.lit > 0.0 and mstate.active > 0.0:
                surface = mstate.surface
            elif on:
                surface = under_wire(z, m, mstate, x, y)
            else:
                surface = height
            if on:
                height -= rise(hot, kept, placed, placed_state, x, y)
            ctwd = REFERENCE_CTWD + height - surface
            advance_arc(
                p=a, s=astate, rng=rng, on=on, gas=gas, blocked=blocked, voltage_set=samples[i].voltage_set,
                ctwd=ctwd, dt=dt,
            )  # fmt: skip
            lit = astate.lit > 0.0
            if lit and not was_lit:
                strike(vary, varied, key, idle)
            wire = astate.wire * arriving(vary, varied) if lit else astate.wire
            power = astate.voltage * astate.current if lit else 0.0
            base = bilinear(
                skin, hstate.origin_x, hstate.origin_y, h.cell,
                x + AHEAD * mstate.head_x, y + AHEAD * mstate.head_y, h.ambient,
            )  # fmt: skip
            melt = (
                z, solid, touched, m, mstate, values, time, dt, x, y, height, lit, wire, power, base, ctwd, gas,
            )  # fmt: skip
            if model == SECTIONS:
                advance_sections(*melt)
            elif model == FILM:
                advance_film(*melt)
            else:
                advance_metal(*melt)
            if mstate.portion > 0.0:
                at_x, at_y = mstate.portion_x, mstate.portion_y
                grow(skin, bulk, thickness, h, hstate, at_x, at_y, mstate.portion)
                mstate.portion = 0.0
            if lit:
                if vary.lumps > 0.0:
                    mstate.deposited += spatter(
                        p=vary, s=varied, key=key, z=z, origin_x=mstate.origin_x, origin_y=mstate.origin_y,
                        cell=m.cell, x=x, y=y, pool=0.5 * mstate.width, before=path,
                    )  # fmt: skip
                add_arc(skin, thickness, h, hstate, x, y, power * dt)
                warm(placed, placed_state, x, y, power * dt)
            hstate.clock += dt
            if hstate.clock >= h.step - 1e-9:
                conduct(skin, bulk, thickness, h, hstate, hstate.clock)
                distort(hot, kept, placed, placed_state, hstate.clock)
                hstate.clock = 0.0

    return live


@jit
def _pose(samples, i, before, zero, out):
    """Position of the torch in the work frame at sample i; i = -1: at the end of the step before."""
    if i < 0:
        out[:] = before
        return
    out[0] = -samples[i].table_x - zero[0]
    out[1] = -samples[i].table_y - zero[1]
    out[2] = samples[i].tool_z - zero[2]


def _make_scan(sources: int) -> Callable:
    @jit
    def scan(
        samples, offsets_us, zero, before, z, origin_x, origin_y, cell, top, hot, kept, lp, ls, sp, lateral, rng,
        place, shared, dropout, out, intensity,
    ):  # fmt: skip
        """Profiles at times counted in us from the first sample; poses between samples are interpolated."""
        if not sources:
            return
        p = sp[0]
        a, b = np.empty(3), np.empty(3)
        for k in range(offsets_us.size):
            i = int(math.floor(offsets_us[k] / 1000.0))
            f = offsets_us[k] / 1000.0 - i
            _pose(samples, i, before, zero, a)
            _pose(samples, min(i + 1, samples.size - 1), before, zero, b)
            if np.isnan(a[0]):
                a[:] = b
            a += f * (b - a)
            profile(
                z=z, origin_x=origin_x, origin_y=origin_y, cell=cell, top=top, hot=hot, kept=kept, placed=lp[0],
                placed_state=ls[0], p=p, lateral=lateral, rng=rng, place=place, shared=shared, tcp_x=a[0],
                tcp_y=a[1], tcp_z=a[2], extra_dropout=dropout, out=out[k], intensity=intensity[k],
            )  # fmt: skip

    return scan


live = _make_live(SOURCES)
scan = _make_scan(SOURCES)
