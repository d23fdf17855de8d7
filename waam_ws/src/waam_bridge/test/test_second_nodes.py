"""Two nodes by one name: neither hides the death of the other. And a node that speaks for another is not believed."""

from __future__ import annotations

import pytest
from bridge_harness import Bridge, VirtualController, until
from hypothesis import given
from hypothesis import strategies as st
from rclpy.node import Node

from waam_bridge import requests
from waam_bridge.arming import Arming
from waam_bridge.lease import SECOND_S, Lease
from waam_bridge.lives import Lives
from waam_msgs.msg import Heartbeat, LeaseTick
from waam_msgs.srv import Command
from waam_node import qos


def test_a_second_publisher_by_a_name_withholds_the_lease():
    arming = Arming()
    arming.arm('j', ['scan_fusion'], 0, 0.0)
    arming.beat('scan_fusion', 100_000, 0, 100_000, 0.1, 'aa')
    assert arming.lease_us(100_000) == 100_000
    arming.beat('scan_fusion', 200_000, 0, 200_000, 0.2, 'bb')
    arming.beat('scan_fusion', 300_000, 0, 300_000, 0.3, 'aa')
    assert arming.lease_us(300_000) == 100_000
    text = arming.twice(['scan_fusion'], 0.4)
    assert 'two nodes called scan_fusion' in text and 'aa, bb' in text
    assert arming.check(600_000, 0.7) == ['scan_fusion']


@given(st.lists(st.tuples(st.sampled_from(['aa', 'bb', 'cc']), st.floats(0.0, 0.5)), max_size=60))
def test_an_armed_lease_never_moves_by_any_other_publisher_than_the_first(beats):
    lease, now = Lease(), 0.0
    lease.require(['a'], 0, 0.0)
    first, seen = None, 0
    for source, wait in beats:
        now += wait
        tick = round(now * 1e6)
        moved = lease.beat('a', tick, 0, tick, now, source)
        first = first or source
        assert not moved or source == first
        seen = max(seen, tick) if moved else seen
    assert lease.seen_us(10**9) == seen


def test_a_node_that_was_started_again_counts_at_the_next_arm():
    arming = Arming()
    arming.arm('j', ['a'], 0, 0.0)
    arming.beat('a', 1, 0, 10, 0.0, 'old')
    arming.disarm()
    later = SECOND_S + 1.0
    arming.beat('a', 2, 0, 10, later, 'new')
    assert arming.twice(['a'], later) == ''
    arming.arm('j', ['a'], 0, later)
    assert arming.beat('a', 3, 0, 10, later, 'new')


def test_another_job_is_armed_although_nobody_disarmed_the_one_whose_node_died():
    arming = Arming()
    arming.arm('j', ['a'], 0, 0.0)
    arming.beat('a', 1, 0, 10, 0.0, 'old')
    later = SECOND_S + 1.0
    arming.beat('a', 2, 0, 10, later, 'new')
    assert 'old' in arming.twice(['a'], later)  # for the job that was armed with the dead one
    assert arming.twice(['a'], later, afresh=True) == ''
    arming.beat('a', 3, 0, 10, later, 'third')
    assert 'new, third' in arming.twice(['a'], later, afresh=True)


def test_processes_are_counted_while_they_speak():
    lives = Lives()
    lives.heard('a@cell:1:x', 0.0)
    lives.heard('a@cell:2:y', 2.0)
    lives.heard('b@cell:3:z', 2.0)
    assert lives.of('a', 2.1) == ['cell:1', 'cell:2']
    assert lives.of('a', 4.0) == ['cell:2'] and lives.of('c', 4.0) == []


class Node2:
    """A node that repeats ticks, as any node does, or under the name of another one."""

    def __init__(self, cell, name: str, told: str = '') -> None:
        self.node = Node(name, context=cell.context)
        self.told, self.silent = told or name, False
        self.out = self.node.create_publisher(Heartbeat, 'heartbeat', qos.BEAT)
        self.node.create_subscription(LeaseTick, 'lease_tick', self._on_tick, qos.BEAT)
        self.cell = cell
        cell._executor.add_node(self.node)

    def _on_tick(self, tick: LeaseTick) -> None:
        if not self.silent:
            us, boot = tick.controller_us, tick.boot_id
            self.out.publish(Heartbeat(node=self.told, controller_us=us, boot_id=boot))

    def close(self) -> None:
        self.cell._executor.remove_node(self.node)
        self.node.destroy_node()


@pytest.fixture
def cell(tmp_path):
    controller = VirtualController(tmp_path)
    bridge = Bridge(controller.path)
    made = []

    def node(*names: str) -> Node2:
        made.append(Node2(bridge, *names))
        return made[-1]

    bridge.another = node
    try:
        yield bridge.ready()
    finally:
        for n in made:
            n.close()
        bridge.close()
        controller.close()


def armed(cell):
    cell.command(Command.Request.RESET)
    return cell.command(Command.Request.ARM, text='j', names=['scan_fusion'])


def silent(cell) -> bool:
    return list(cell.state.silent_nodes) == ['scan_fusion']


def test_a_foreign_node_does_not_hide_that_a_required_one_is_dead(cell):
    node = cell.another('scan_fusion')
    until(lambda: node.out.get_subscription_count() >= 2)
    assert armed(cell).error_code == requests.OK
    until(lambda: cell.state.armed and not silent(cell))
    foreign = cell.another('attacker', 'scan_fusion')
    until(lambda: any('not believed' in a.text for a in cell.got['anomaly']))
    assert not silent(cell), 'nobody can take the lease away like this either'
    node.silent = True
    until(lambda: silent(cell))
    assert foreign.out.get_subscription_count() >= 2


def test_a_second_node_by_the_same_name_is_named_and_keeps_the_arc_off(cell):
    node = cell.another('scan_fusion')
    until(lambda: node.out.get_subscription_count() >= 2)
    assert armed(cell).error_code == requests.OK
    until(lambda: cell.state.armed and not silent(cell))
    second = cell.another('scan_fusion')
    until(lambda: silent(cell))
    until(lambda: any('two nodes called scan_fusion' in a.text for a in cell.got['anomaly']))
    node.silent = True  # the first has died: the second does not take its place
    until(lambda: cell.state.message.startswith('two nodes called scan_fusion'))
    assert silent(cell)
    node.silent = False
    cell.command(Command.Request.DISARM)
    refused = armed(cell)
    assert refused.error_code == requests.WRONG_STATE
    assert 'ARM: two nodes called scan_fusion' in refused.message
    second.silent = True
    until(lambda: armed(cell).error_code == requests.OK)
