"""Parameters of feed_forward; `config/feed_forward.yaml` lists the same."""

from __future__ import annotations

from dataclasses import dataclass

from waam_node.params import param
from waam_process.units import m_min


@dataclass(frozen=True)
class FeedParams:
    """Parameters of the node feed_forward."""

    materials_file: str = param(
        '', "operator's table that adds to or replaces the packaged materials"
    )
    speed_min: float = param(3e-3, 'slowest travel of the machine while depositing', 'm/s', 1e-4)
    speed_max: float = param(20e-3, 'fastest travel of the machine while depositing', 'm/s', 1e-3)
    feed_min: float = param(m_min(2.0), 'slowest wire feed of the source', 'm/s', 0.0)
    feed_max: float = param(m_min(12.0), 'fastest wire feed of the source', 'm/s', 1e-3)
