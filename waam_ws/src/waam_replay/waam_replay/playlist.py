"""What of a record is published, when, and what must not be: the replay without the graph."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from mcap.records import Message

from waam_record.bag_copy import Selection, messages, topics_of
from waam_record.bag_reader import bag_files, info
from waam_record.bag_writer import Topic

# Topics that move a machine or keep its arc alive. Published only with `force`.
COMMANDS = re.compile(
    r'(^|/)(override|process_override|lease_tick|heartbeat|weld_command|joint_trajectory)$|/_action/|/cmd_|(^|/)enqueue$'
)
MACHINE_NODES = ('bridge', 'job_sequencer', 'joint_trajectory_controller')
TF_STATIC = '/tf_static'
NEVER = re.compile(r'/_service_event$|^/clock$|^/rosout$|^/parameter_events$')


@dataclass(frozen=True)
class Wanted:
    """What the user asked for."""

    topics: tuple[str, ...] = ()  # names; empty = all
    exclude: str = ''  # regular expression
    remap: tuple[tuple[str, str], ...] = ()  # recorded to published names
    start: float = 0.0  # s after the beginning
    until: float = 0.0  # s after the beginning; 0 = end
    force: bool = False  # commands and topics of others too


def against_live(nodes: set[str], wanted: Wanted) -> str:
    """Why a graph with these nodes gets no replay, '' = it may have it: where one of them works for a machine, only
    topics that were named are published, and nothing by force."""
    live = [n for n in MACHINE_NODES if n in nodes]
    if not live or (wanted.topics and not wanted.force):
        return ''
    return (
        f"'{live[0]}' runs in this ROS domain: a replay would reach its machine. Play into another one "
        '(ROS_DOMAIN_ID=77 waam replay play ...), or name what is to be published with --topics, without --force'
    )


def parse_remap(texts: list[str]) -> tuple[tuple[str, str], ...]:
    """`from:=to` texts; ValueError names the one that is not."""
    pairs = []
    for text in texts:
        old, separator, new = text.partition(':=')
        if not (separator and old and new):
            raise ValueError(f"remap '{text}' is not of the form from:=to")
        pairs.append((_absolute(old), _absolute(new)))
    return tuple(pairs)


def _absolute(name: str) -> str:
    return name if name.startswith('/') else f'/{name}'


class Playlist:
    """Topics and messages of a record for one replay. BagError when the record is not whole."""

    def __init__(self, folder: Path, wanted: Wanted) -> None:
        self.files, self.wanted = bag_files(folder), wanted
        self.first_ns = min(info(f).first_ns for f in self.files)
        self.last_ns = max(info(f).last_ns for f in self.files)
        self._names = dict(wanted.remap)
        known = {t.name: t for f in self.files for t in topics_of(f)}
        if missing := [t for t in wanted.topics if _absolute(t) not in known]:
            raise ValueError(f"the record has no topic '{missing[0]}'; see: waam record info")
        self._known = known

    @property
    def until_ns(self) -> int:
        """Recorded time at which the replay ends."""
        w = self.wanted
        return self.first_ns + round(w.until * 1e9) if w.until > 0 else self.last_ns

    def published_name(self, topic: str) -> str:
        """After `remap`; the recorded name when it is not remapped."""
        return self._names.get(topic, topic)

    def allowed(self, taken: set[str]) -> tuple[dict[str, Topic], dict[str, str]]:
        """Topics to publish, by recorded name; and those left out although they were wanted, with the reason.

        taken: names that somebody else in the graph publishes.
        """
        chosen, refused = {}, {}
        named = {_absolute(t) for t in self.wanted.topics}
        for name, topic in self._known.items():
            if NEVER.search(name) or (named and name not in named):
                continue
            if self.wanted.exclude and re.search(self.wanted.exclude, name):
                continue
            target = self.published_name(name)
            if not self.wanted.force and COMMANDS.search(target):
                refused[name] = 'commands a machine (--force publishes it)'
            elif not self.wanted.force and target in taken:
                refused[name] = f'{target} has a publisher in this graph (--remap or --force)'
            else:
                chosen[name] = topic
        return chosen, refused

    def messages(self, names: set[str], from_ns: int) -> Iterator[tuple[str, Message]]:
        """Messages of these topics by log time, from `from_ns` to the end that was asked for."""
        start = (from_ns - self.first_ns) * 1e-9
        selection = Selection(topics=tuple(names), start=start)
        for topic, message in messages(self.files, selection):
            if message.log_time > self.until_ns:
                return
            if message.log_time >= from_ns:
                yield topic.name, message

    def latched_before(self, names: dict[str, Topic], at_ns: int) -> list[tuple[str, Message]]:
        """The last message of every latched topic before `at_ns`: what a late joiner would have seen; of /tf_static,
        which several nodes publish, all of them."""
        latched = {n for n, t in names.items() if t.latched}
        found: dict[tuple[str, int], tuple[str, Message]] = {}
        for topic, message in (
            messages(self.files, Selection(topics=tuple(latched))) if latched else ()
        ):
            if message.log_time >= at_ns:
                break
            which = message.log_time if topic.name == TF_STATIC else 0
            found[topic.name, which] = topic.name, message
        return list(found.values())
