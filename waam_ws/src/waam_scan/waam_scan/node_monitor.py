"""What scan_fusion reports about itself: diagnostics, anomalies, log."""

from __future__ import annotations

import time

from waam_msgs.msg import Anomaly
from waam_node.node import OK, WARN, WaamNode
from waam_node.qos import EVENTS

from .fusion.quality import MapQuality, assess
from .map_maker import ScanMap
from .stream.poses import PoseTrack
from .stream.session import Session

COUNTERS = ('telemetry', 'batches', 'idle_batches', 'refused_batches', 'maps', 'empty_maps')


def quality_values(q: MapQuality) -> dict[str, str]:
    """For the diagnostics; areas in mm², sigma in mm."""
    return {
        'holes': str(q.holes),
        'hole_area_mm2': f'{q.hole_area * 1e6:.3f}',
        'largest_hole_mm2': f'{q.largest_hole * 1e6:.3f}',
        'unseen': f'{q.unseen:.4f}',
        'steep_cells': f'{q.steep:.5f}',
        'edge_cells': f'{q.edges:.5f}',
        'sigma_mm': f'{q.sigma * 1e3:.5f}',
        'points_per_cell': f'{q.points:.1f}',
    }


class FusionMonitor:
    """Counters of the node and the diagnostics made from them; `count` is written by the node."""

    def __init__(self, node: WaamNode, track: PoseTrack) -> None:
        self._node, self._track = node, track
        self.count = dict.fromkeys(COUNTERS, 0)
        self._reported, self._reported_at = dict(self.count), time.monotonic()
        self._anomaly_at = -1.0
        self._publisher = node.create_publisher(Anomaly, 'anomaly', EVENTS)

    def anomaly(self, text: str, severity: int, session: Session) -> None:
        """Log and topic, warnings once per second at most: a broken scanner must not flood the record."""
        now = time.monotonic()
        if severity < Anomaly.FAULT and now - self._anomaly_at < 1.0:
            return
        self._anomaly_at = now
        self._node.get_logger().warning(text)
        msg = Anomaly(severity=severity, class_name='scan', text=text, reaction='none')
        msg.header.stamp = self._node.get_clock().now().to_msg()
        msg.header.frame_id = 'work'
        msg.job_id, msg.layer = session.job_id, session.layer
        self._publisher.publish(msg)

    def no_map(self, text: str, session: Session) -> None:
        """A scan has ended without a map, for the reason `text`: counted, published as a fault, shown in the
        diagnostics."""
        self.count['empty_maps'] += 1
        self._node.level, self._node.message = WARN, text
        self.anomaly(text, Anomaly.FAULT, session)

    def new_map(self, session: Session, found: ScanMap, latency: float) -> None:
        """latency: s from the arrival of the last profile to the published map, wall time."""
        fused, doubts, counts = found.fused, found.doubts, session.counts
        self.count['maps'] += 1
        self._node.level, self._node.message = (WARN, doubts[0]) if doubts else (OK, 'ok')
        self._node.values |= {
            'map_latency_ms': f'{latency * 1e3:.1f}',
            'coverage': f'{fused.coverage:.4f}',
            'residual_mm': f'{fused.residual * 1e3:.4f}',
            'profiles_used': counts.used,
            'profiles_rejected': counts.rejected,
            'points_used': fused.points_used,
            'dropouts': fused.dropouts,
            'spikes': fused.spikes,
            'outside': fused.outside,
            'batches_lost': session.lost,
            'profiles_out_of_order': counts.out_of_order,
            'profile_pauses': counts.breaks,
            'longest_pause_s': f'{counts.longest_break:.3f}',
        }
        self._node.values |= quality_values(assess(fused))
        self._node.get_logger().info(
            f"job '{session.job_id}' layer {session.layer}: map {session.scan_id} "
            f'of {counts.used} profiles, coverage {fused.coverage:.1%}, '
            f'scatter {fused.residual * 1e3:.3f} mm, {latency * 1e3:.0f} ms after the last profile'
        )
        if doubts:
            text = f'map {session.scan_id} is not plausible: {"; ".join(doubts)}'
            self.anomaly(text, Anomaly.WARNING, session)

    def report(self, session: Session | None) -> None:
        """Rates and counters into the diagnostics; called at 1 Hz of steady time."""
        now = time.monotonic()
        for name in ('telemetry', 'batches'):
            rate = (self.count[name] - self._reported[name]) / max(1e-3, now - self._reported_at)
            self._node.values[f'{name}_per_s'] = f'{rate:.1f}'
        self._reported, self._reported_at = dict(self.count), now
        track = self._track
        self._node.values |= self.count | {
            'scanning': session is not None,
            'profiles_waiting': session.waiting if session else 0,
            'poses': len(track),
            'poses_repeated': track.repeated,
            'poses_out_of_order': track.out_of_order,
            'poses_not_finite': track.not_finite,
            'clock_restarts': track.restarts,
        }
