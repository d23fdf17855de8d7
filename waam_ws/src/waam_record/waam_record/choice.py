"""Which topics of a graph are recorded: by name, by regular expression, by type."""

from __future__ import annotations

import re
from dataclasses import dataclass


class ChoiceError(ValueError):
    """A regular expression that is none; the text names it."""


@dataclass(frozen=True)
class Choice:
    """Topics that are recorded. Lists are separated by blanks.

    A topic is taken when topics, regex or types names it, or when all three are empty; exclude then leaves topics out.
    Of topics that are not below `below`, the namespace of the recorder, only those that topics names are taken.
    """

    topics: str = ''  # names, with their leading slash
    regex: str = ''  # is looked for in names
    types: str = ''  # `package/msg/Name`
    exclude: str = ''  # is looked for in names
    below: str = '/'

    def __post_init__(self) -> None:
        for name in ('regex', 'exclude'):
            try:
                re.compile(getattr(self, name))
            except re.error as e:
                text = getattr(self, name)
                raise ChoiceError(
                    f"parameter '{name}': '{text}' is no regular expression: {e}"
                ) from None

    def wants(self, topic: str, types: list[str]) -> bool:
        """Whether the topic with these types (one, if all is well) is recorded."""
        if not is_below(topic, self.below) and topic not in self.topics.split():
            return False
        if self.exclude and re.search(self.exclude, topic):
            return False
        if not (self.topics or self.regex or self.types):
            return True
        named = topic in self.topics.split() or bool(set(types) & set(self.types.split()))
        return named or bool(self.regex and re.search(self.regex, topic))


def is_below(name: str, namespace: str) -> bool:
    """Whether a topic, service or node of this full name is in the namespace; / = all are."""
    return name.startswith(namespace.rstrip('/') + '/')
