"""Repeats the job's requests to the nodes, each after everything that had arrived before it, and compares the answers
with the recorded ones. Nothing waits for time to pass: the next step begins when the last answer is there.
"""

from __future__ import annotations

import json
import time
from array import array
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from rcl_interfaces.srv import GetParameters
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from rosgraph_msgs.msg import Clock
from std_srvs.srv import SetBool

from waam_msgs.msg import CorrectionMap, HeightMap, ProfileBatch, Telemetry
from waam_msgs.srv import BeginScan, ComputeCorrection, ComputeFeed, FinishScan
from waam_node.files import write_atomically
from waam_node.node import CallError, call
from waam_node.qos import LATCHED, PROFILES, TELEMETRY
from waam_record.read_record import Exchange, load

from .steps import Step, steps

KINDS = {
    'begin': (BeginScan, 'scan_fusion/begin', 'scan_fusion'),
    'finish': (FinishScan, 'scan_fusion/finish', 'scan_fusion'),
    'correct': (ComputeCorrection, 'correction_server/compute', 'correction_server'),
    'feed': (ComputeFeed, 'feed_forward/compute', 'feed_forward'),
}
REFUSED = {  # requests that every node refuses without side effects: they show that answers arrive
    'begin': BeginScan.Request(),
    'finish': FinishScan.Request(scan_id=2**32 - 1),
    'correct': ComputeCorrection.Request(),
    'feed': ComputeFeed.Request(),
}
PATIENCE_S = 60.0  # longest wait for an answer, wall time
AT_ONCE = 200  # messages between two waits for the nodes: less than their queues hold


@dataclass
class Report:
    """How the answers of the nodes compare with the recorded ones."""

    identical: dict[str, int] = field(
        default_factory=lambda: dict.fromkeys(('maps', 'psi', 'setpoints'), 0)
    )
    total: dict[str, int] = field(
        default_factory=lambda: dict.fromkeys(('maps', 'psi', 'setpoints'), 0)
    )
    differences: list[str] = field(default_factory=list)  # in words
    seconds: float = 0.0
    error: str = ''

    @property
    def same(self) -> bool:
        """Every answer was there and equals the recorded one in every field; False when nothing was asked."""
        return not self.error and self.identical == self.total and any(self.total.values())

    def add(self, kind: str, what: str, fields: list[str]) -> None:
        """Counts an answer of a kind ('maps', 'psi', 'setpoints'); fields: in which it differs, none = identical."""
        self.total[kind] += 1
        self.identical[kind] += not fields
        if fields:
            self.differences.append(f'{what} differs in {", ".join(fields)}')

    def as_json(self) -> str:
        """All fields and `same`."""
        return json.dumps({**self.__dict__, 'same': self.same}, indent=1)


class Lockstep:
    """`run` belongs to a thread of its own; the node's executor must spin meanwhile."""

    def __init__(self, node: Node, folder: Path, report: str = '') -> None:
        self.node, self.folder = node, folder
        self.report, self._file = Report(), report
        self._seen: dict[str, list[Any]] = {'maps': [], 'psi': []}
        self._telemetry = node.create_publisher(Telemetry, 'telemetry', TELEMETRY)
        self._profiles = node.create_publisher(ProfileBatch, 'profiles', PROFILES)
        self._clock = node.create_publisher(Clock, '/clock', 10)
        node.create_subscription(HeightMap, 'height_map', self._on_map, LATCHED)
        node.create_subscription(CorrectionMap, 'correction_map', self._on_psi, LATCHED)
        node.create_service(SetBool, 'scanner/enable', self._enable)
        self._clients = {k: node.create_client(t, name) for k, (t, name, _) in KINDS.items()}
        self._pings = {
            name: node.create_client(GetParameters, f'{name}/get_parameters')
            for _, _, name in KINDS.values()
        }

    def _on_map(self, msg: HeightMap) -> None:
        self._seen['maps'].append(msg)

    def _on_psi(self, msg: CorrectionMap) -> None:
        self._seen['psi'].append(msg)

    def _enable(self, _: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        """The scanner of the record is always on; its profiles come when it is their turn."""
        response.success = True
        return response

    def run(self) -> None:
        """Plays everything; what went wrong is in `report`."""
        try:
            plan = steps(load(self.folder))
            self._meet({s.call.kind for s in plan})
            started = time.monotonic()
            for step in plan:
                self._step(step)
            self.report.seconds = time.monotonic() - started
        except (CallError, ValueError, OSError) as e:
            self.report.error = str(e)
            self.node.get_logger().error(str(e))
        self.node.get_logger().info(
            f'lock-step: {self.report.identical} of {self.report.total} identical'
        )
        if self._file:
            write_atomically(Path(self._file), self.report.as_json())

    def _meet(self, kinds: set[str]) -> None:
        """Waits until every node that is needed answers, so that no answer is lost later."""
        for kind in sorted(kinds):
            self._answered(lambda k=kind: call(self._clients[k], REFUSED[k], 3.0))
            self._ping(KINDS[kind][2])
        publishers = (self._telemetry, self._profiles)
        self._until(
            lambda: all(p.get_subscription_count() for p in publishers), 'nobody takes profiles'
        )

    def _answered(self, ask: Any) -> Any:
        """Repeats a harmless request until it is answered."""
        end = time.monotonic() + PATIENCE_S
        while True:
            try:
                return ask()
            except CallError:
                if time.monotonic() > end:
                    raise

    def _until(self, condition: Any, text: str) -> None:
        end = time.monotonic() + PATIENCE_S
        while not condition():
            if time.monotonic() > end:
                raise CallError(f'{text} (waited {PATIENCE_S:.0f} s)')
            time.sleep(0.002)

    def _ping(self, node: str) -> None:
        """Returns when the node has processed what it got before."""
        self._answered(lambda: call(self._pings[node], GetParameters.Request(), 3.0))

    def _step(self, step: Step) -> None:
        self._give(step.inputs)
        self._set_clock(step.call.ros_ns)
        self._ping(KINDS[step.call.kind][2])
        self._ask(step.call)

    def _give(self, inputs: list[tuple[bool, bytes]]) -> None:
        """Telemetry and profiles in their order; never more on the way than the nodes keep."""
        on_the_way = 0
        for is_profile, data in inputs:
            (self._profiles if is_profile else self._telemetry).publish(data)
            on_the_way += 10 if is_profile else 1
            if on_the_way >= AT_ONCE:
                self._settle()
                on_the_way = 0
        if on_the_way:
            self._settle()

    def _settle(self) -> None:
        for publisher in (self._telemetry, self._profiles):
            if not publisher.wait_for_all_acked(Duration(seconds=PATIENCE_S)):
                raise CallError(f'{publisher.topic_name} is not taken within {PATIENCE_S:.0f} s')
        self._ping('scan_fusion')

    def _set_clock(self, ns: int) -> None:
        msg = Clock()
        msg.clock.sec, msg.clock.nanosec = divmod(ns, 1_000_000_000)
        for _ in range(3):  # /clock is heard best effort
            self._clock.publish(msg)

    def _ask(self, question: Exchange) -> None:
        kind = question.kind
        request = deserialize_message(question.data, KINDS[kind][0].Event).request[0]
        wanted = deserialize_message(question.answer, KINDS[kind][0].Event).response[0]
        answer = call(self._clients[kind], request, PATIENCE_S)
        if answer.error_code != wanted.error_code:
            self.report.differences.append(
                f'{KINDS[kind][1]}: error {answer.error_code} ({answer.message}), recorded {wanted.error_code}'
            )
        if kind == 'finish' and not wanted.error_code:
            self._compare('maps', answer.map, wanted.map, f'map after layer {wanted.map.layer}')
        elif kind == 'correct' and not wanted.error_code:
            name = f'psi of layer {wanted.correction.layer}'
            self._compare('psi', answer.correction, wanted.correction, name)
        elif kind == 'feed' and not wanted.error_code:
            fields = different_fields(answer, wanted)
            self.report.add(
                'setpoints', f'setpoints of call {self.report.total["setpoints"] + 1}', fields
            )

    def _compare(self, kind: str, answer: Any, wanted: Any, what: str) -> None:
        """What was published, not only what was answered."""
        seen = self._seen[kind]
        self._until(
            lambda: any(not different_fields(answer, m) for m in list(seen)),
            f'{what} was not published',
        )
        seen.clear()
        self.report.add(kind, what, different_fields(answer, wanted))


def different_fields(a: Any, b: Any) -> list[str]:
    """Names of the fields that differ in a bit; the wall time of a computation is none of them."""
    names = [n for n in a.get_fields_and_field_types() if n != 'latency']
    return [n for n in names if not same(getattr(a, n), getattr(b, n))]


def same(a: Any, b: Any) -> bool:
    """Equal to the last bit; NaN equals NaN. (Serialised messages cannot be compared: their padding is not set.)"""
    if hasattr(a, 'get_fields_and_field_types'):
        return not different_fields(a, b)
    if isinstance(a, array | np.ndarray):
        return np.asarray(a).tobytes() == np.asarray(b).tobytes()
    if isinstance(a, list | tuple):
        return len(a) == len(b) and all(map(same, a, b))
    return a == b or (a != a and b != b)
