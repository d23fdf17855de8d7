"""What a page is sent and when: what is now first and small, what was in pieces, only as fast as it is taken."""

from __future__ import annotations

import asyncio
import json
import time

import aiohttp
from hypothesis import given, settings
from hypothesis import strategies as st
from test_panel_core import sample

from waam_panel.alarms import AlarmLog
from waam_panel.sources import PROGRAMS
from waam_panel.state import PanelState
from waam_panel.stream import ALARMS, PIECE

FIRST = 10_000  # bytes of the first frame at most
KEPT = 7200


def filled(panel, samples: int = KEPT) -> PanelState:
    """The state of a panel after a long shift: curves, alarms, programs."""
    state = PanelState(KEPT)
    for i in range(samples):
        state.apply('telemetry', sample(i), 0.0, 0.0)
    for i in range(150):  # there is room for more: silent programs become alarms meanwhile
        state.alarms.event(
            float(i), 'controller', 200 + i, 2, 'what the controller says of it ' * 3
        )
    rows = [
        {'node': n, 'level': 0, 'message': 'ok ' * 20, 'viewer': '', 'restarted': ''}
        for n in PROGRAMS
    ]
    state.apply('diagnostics', rows, time.monotonic(), 0.0)
    for name in ('machine', 'job', 'heat', 'link'):
        state.sections[name] = {f'field {i}': 'x' * 12 for i in range(24)} | {'state': 'IDLE'}
    panel.cell.state = state
    return state


def listen(panel, enough, slow: float = 0.0) -> list[str]:
    """Messages until `enough` holds for what has come; `slow` s are taken for each."""

    async def go() -> list[str]:
        found: list[str] = []
        async with aiohttp.ClientSession() as session:
            headers = {'Origin': panel.url}
            async with session.ws_connect(
                f'{panel.url}/stream', headers=headers, max_msg_size=0
            ) as ws:
                end = time.monotonic() + 120
                while not enough(found):
                    assert time.monotonic() < end, f'not enough in {len(found)} messages'
                    found.append(await ws.receive_str(timeout=30))
                    await asyncio.sleep(slow)
        return found

    return asyncio.run(go())


def put_together(messages: list[str]) -> tuple[list, dict]:
    samples, alarms = [], {}
    for frame in map(json.loads, messages):
        samples = frame.get('history', []) + samples + frame.get('samples', [])
        alarms |= {a['id']: a for a in frame.get('alarms', [])}
    return samples, alarms


def test_the_first_frame_is_small_and_says_what_is_now(panel):
    state = filled(panel)
    (first,) = listen(panel, lambda f: f)
    frame = json.loads(first)
    assert len(first) <= FIRST, len(first)
    assert frame['samples'] == [] and len(frame['alarms']) <= ALARMS
    assert set(frame['sections']) >= {'machine', 'job', 'heat', 'link', 'telemetry', 'programs'}
    assert frame['top'] == frame['alarms'][0]['id'] == state.alarms.top().id


def test_the_past_follows_in_pieces_the_newest_first_and_whole(panel):
    state = filled(panel)
    known = {a['id'] for a in state.alarms.listing()}
    messages = listen(
        panel, lambda f: known <= put_together(f)[1].keys() and len(put_together(f)[0]) >= KEPT
    )
    frames = [json.loads(m) for m in messages]
    pieces = [f['history'] for f in frames if 'history' in f]
    assert max(len(m) for m in messages) <= FIRST
    assert all(0 < len(p) <= PIECE for p in pieces)
    starts = [p[0][0] for p in pieces]
    assert starts == sorted(starts, reverse=True) and pieces[0][-1] == state.samples[-1]
    samples, alarms = put_together(messages)
    assert samples == list(state.samples)
    assert known <= alarms.keys()


def test_a_frame_holds_only_what_has_changed(panel):
    filled(panel, 0)
    frames = [json.loads(m) for m in listen(panel, lambda f: len(f) == 60)]
    assert not any(
        f['sections']
        for f in frames[1:]
        if 'ages' in f and set(f['sections']) - {'cell', 'commission', 'programs'}
    )


def test_live_frames_go_before_the_past_and_nothing_piles_up_for_a_slow_page(panel):
    """A page that takes a message every 0.2 s: between two frames there is at most one piece of the past."""
    filled(panel)
    frames = [json.loads(m) for m in listen(panel, lambda f: len(f) == 24, slow=0.25)]
    past = ['history' in f for f in frames]
    assert not any(a and b for a, b in zip(past, past[1:], strict=False)), past
    told = [f['utc'] for f in frames if 'utc' in f]
    assert all(
        b - a >= 0.2 for a, b in zip(told, told[1:], strict=False)
    )  # each waited for the one before


@given(st.integers(1, 60), st.integers(0, 200), st.integers(1, 17))
def test_pieces_of_the_past_are_the_samples_before_and_no_others(kept, taken, most):
    state = PanelState(kept)
    for i in range(taken):
        state.apply('telemetry', sample(i), 0.0, 0.0)
    found, before = [], state.taken
    while True:
        before, piece = state.history(before, most)
        if not piece:
            break
        assert len(piece) <= most
        found = piece + found
    assert found == list(state.samples)


@settings(max_examples=60)
@given(
    st.lists(st.tuples(st.integers(0, 5), st.integers(200, 206)), max_size=60), st.integers(1, 4)
)
def test_a_page_ends_with_the_alarms_that_there_are(steps, most):
    log, seen, page = AlarmLog(kept=9), {}, {}
    for now, (what, code) in enumerate(steps):
        if what == 0:
            log.acknowledge(None if code == 200 else now // 2)
        elif what == 1:
            log.set('fault', now, 'controller', code, 2, f'text {now}')
        elif what == 2:
            log.clear('fault')
        elif what == 3:
            log.job(('running', 'paused', 'ended')[code % 3])
        else:
            log.event(now, 'job' if what == 4 else 'controller', code, 2, f'E{code} {now % 3}')
        page |= {a['id']: a for a in log.changed(seen, most)}
    while new := log.changed(seen, most):
        page |= {a['id']: a for a in new}
    listing = log.listing()
    assert [page[a['id']] for a in listing] == listing
