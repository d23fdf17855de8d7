"""Which topics of a graph are recorded."""

from __future__ import annotations

import re
from dataclasses import dataclass


@dataclass(frozen=True)
class Choice:
    """All topics of the namespace `below`, but those in whose names the regular expression `exclude` is found ('' =
    none). ValueError for an expression that is none."""

    exclude: str = ''
    below: str = '/'

    def __post_init__(self) -> None:
        try:
            re.compile(self.exclude)
        except re.error as e:
            raise ValueError(
                f"parameter 'exclude': '{self.exclude}' is no regular expression: {e}"
            ) from None

    def wants(self, topic: str) -> bool:
        """Whether the topic is recorded."""
        left_out = self.exclude and re.search(self.exclude, topic)
        return is_below(topic, self.below) and not left_out


def is_below(name: str, namespace: str) -> bool:
    """Whether a topic, service or node of this full name is in the namespace; / = all are."""
    return name.startswith(namespace.rstrip('/') + '/')
