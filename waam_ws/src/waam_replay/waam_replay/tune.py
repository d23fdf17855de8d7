"""A recorded job computed again with other parameters, layer by layer, and set beside what was recorded.

Every layer starts from the surface that was really there: other parameters change what would have been commanded on
it, not the scans that follow. No graph, no clock, no random number: two runs give the same bits.
"""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from waam_record.read_record import Record, load

from .corrections import Corrections, PsiAgain
from .maps import MapAgain, Mapper
from .parameters import Parameters, effective
from .setpoints import FeedAgain, one


@dataclass
class Layer:
    """One layer: psi is None where the job asked for no correction (open loop)."""

    number: int
    feed: FeedAgain | None = None
    psi: PsiAgain | None = None


@dataclass
class Tuning:
    """A job computed again. seconds: wall time of reading and computing; machine_seconds: what it took in the cell."""

    record: Record
    parameters: Parameters
    maps: list[MapAgain] = field(default_factory=list)
    layers: list[Layer] = field(default_factory=list)
    seconds: float = 0.0

    @property
    def machine_seconds(self) -> float:
        """s of ROS time that the record covers."""
        return self.record.duration

    @property
    def identical(self) -> dict[str, tuple[int, int]]:
        """How many of maps, corrections and sets of setpoints equal the recorded ones to the last bit, of how many."""
        psi = [layer.psi for layer in self.layers if layer.psi]
        feed = [layer.feed for layer in self.layers if layer.feed]
        groups: dict[str, Sequence[MapAgain | PsiAgain | FeedAgain]] = {
            'maps': self.maps,
            'psi': psi,
            'setpoints': feed,
        }
        return {name: (sum(a.identical for a in g), len(g)) for name, g in groups.items()}

    @property
    def same(self) -> bool:
        """Everything equals the record to the last bit."""
        return bool(self.maps) and all(n == of for n, of in self.identical.values())

    @property
    def digest(self) -> str:
        """SHA-256 of everything that was computed: equal digests are equal to the last bit."""
        h = hashlib.sha256()
        for m in self.maps:
            for a in (m.z, m.sigma, m.count):
                h.update(a.tobytes())
        for layer in self.layers:
            if layer.psi:
                c = layer.psi.result
                for a in (c.psi, c.confidence, c.residual_height, np.array(layer.psi.flow_factor)):
                    h.update(np.asarray(a, float).tobytes())
            if layer.feed:
                s = layer.feed.result
                for a in (s.speed, s.wire_feed_speed, s.voltage, s.clamps):
                    h.update(np.ascontiguousarray(a).tobytes())
        return h.hexdigest()


def tune(
    path: Path, settings: list[str] | None = None, tick: Callable[[int], None] = lambda n: None
) -> Tuning:
    """The job in `path` with `settings` (node.parameter=value). ParameterError, ReplayError or BagError say what is
    wrong; tick(n) is called with messages read."""
    effective({}, settings or [])  # a misspelt name is found before anything is read
    started = time.perf_counter()
    record = load(path, tick)
    parameters = effective(record.parameters, settings or [], record.loop_mode)
    result = Tuning(record, parameters)
    result.maps = Mapper(record, parameters.scan_fusion).all()
    _corrections(result)
    _setpoints(result)
    result.seconds = time.perf_counter() - started
    return result


def _corrections(result: Tuning) -> None:
    corrections = Corrections(result.parameters.correction_server, result.parameters.job.k_gain)
    for call in result.record.calls['correct']:
        if call.response is None or call.response.error_code:
            continue
        again = corrections.one(call, _surface(result, call.request.map))
        result.layers.append(Layer(again.layer, psi=again))


def _surface(result: Tuning, map_msg: Any) -> MapAgain | None:
    """The map of that job and scan, computed again."""
    key = map_msg.job_id, map_msg.scan_id, map_msg.layer
    return next(
        (m for m in result.maps if m.whole
         and (m.recorded.job_id, m.recorded.scan_id, m.recorded.layer) == key),
        None,
    )  # fmt: skip


def _setpoints(result: Tuning) -> None:
    for call in result.record.calls['feed']:
        if call.response is None or call.response.error_code:
            continue
        number = call.request.correction.layer if len(call.request.correction.psi) else 0
        layer = next((x for x in reversed(result.layers) if x.psi and x.number == number), None)
        p = result.parameters
        again = one(call, layer.psi if layer else None, p.feed_forward, p.job)
        if layer is None:
            layer = Layer(again.layer)
            result.layers.append(layer)
        layer.feed = again
