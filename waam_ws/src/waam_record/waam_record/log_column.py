"""What the readers of foreign logs return: topics with their messages."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from .bag_writer import Topic

QOS = {
    'history': 'unknown',
    'depth': 0,
    'reliability': 'reliable',
    'durability': 'volatile',
    'deadline': {'sec': 9223372036, 'nsec': 854775807},
    'lifespan': {'sec': 9223372036, 'nsec': 854775807},
    'liveliness': 'automatic',
    'liveliness_lease_duration': {'sec': 9223372036, 'nsec': 854775807},
    'avoid_ros_namespace_conventions': False,
}  # quality of service of imported topics: unknown, so the defaults of ROS 2


@dataclass(frozen=True)
class Column:
    """One topic of a log: messages as (stamp ns, CDR bytes) in any order."""

    topic: Topic
    messages: Iterable[tuple[int, bytes]]
