import re
from pathlib import Path

import pytest

import waam_scan
from waam_scan.node_waiting import Event, first, start

PLUMBING = {
    'conversions.py', 'node_monitor.py', 'node_waiting.py', 'scan_fusion_node.py',
}  # fmt: skip


def run(coroutine):
    """What the coroutine returned and what it raised, so far."""
    out = {'done': [], 'failed': []}
    start(coroutine, out['done'].append, out['failed'].append)
    return out


def test_a_coroutine_waits_for_events_in_turn_and_gives_its_result():
    a, b = Event(), Event()

    async def work():
        return [await a, await b]

    out = run(work())
    b.set(2)
    assert out['done'] == []
    a.set(1)
    a.set(99)
    assert out['done'] == [[1, 2]] and out['failed'] == []


@pytest.mark.parametrize('early', [True, False])
def test_the_first_event_wins(early):
    a, b = Event(), Event()
    if early:
        b.set('b')

    async def work():
        return await first(a, b)

    out = run(work())
    b.set('b')
    a.set('a')
    assert out['done'] == ['b']


def test_an_error_after_waiting_is_handed_over():
    event = Event()

    async def work():
        await event
        raise KeyError('x')

    out = run(work())
    event.set()
    assert out['done'] == [] and isinstance(out['failed'][0], KeyError)


def test_the_core_knows_nothing_of_ros_or_the_clock():
    for path in Path(waam_scan.__file__).parent.glob('**/*.py'):
        if path.name in PLUMBING or path.name.startswith('node_'):
            continue
        text = path.read_text()
        found = re.findall(r'^\s*(?:import|from) (rclpy|waam_msgs|\w+_msgs|time)\b', text, re.M)
        assert not found, f'{path.name} imports {found}'
