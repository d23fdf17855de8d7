"""Recordings of others into MCAP: ROS 1 bags and SQLite bags, which say themselves what they hold (`rosbags` converts
them). Logs with columns: `foreign`."""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path

from .bag_copy import messages
from .bag_reader import bag_files
from .bag_writer import BagError, BagWriter, Topic
from .log_column import QOS, Column

BAGS = ('.bag', '.db3')


def known(path: Path) -> bool:
    """Whether a file says itself what it holds."""
    return path.is_dir() or path.suffix.lower() in BAGS


def write(columns: list[Column], output: Path, sources: list[str]) -> int:
    """One recording of topics, by time; returns the number of messages."""
    names = [c.topic.name for c in columns]
    if twice := [n for n in names if names.count(n) > 1]:
        raise BagError(f"topic '{twice[0]}' comes from two of the files: import them one by one")
    rows = [(stamp, number, data) for number, c in enumerate(columns) for stamp, data in c.messages]
    if not rows:
        raise BagError('there is not one message in these files')
    rows.sort(key=lambda row: row[0])
    writer = BagWriter(output, {'imported_from': ', '.join(sources)})
    sequences = [0] * len(columns)
    numbers = [writer.add_topic(c.topic) for c in columns]
    for stamp, number, data in rows:
        sequences[number] += 1
        writer.write(numbers[number], stamp, stamp, sequences[number], data)
    writer.close()
    return writer.messages


def read_bag(path: Path) -> list[Column]:
    """Topics of a ROS 1 bag or of any ROS 2 bag that `rosbags` opens, as ROS 2 messages: types of the standard packages
    get their ROS 2 definition (no `seq` in headers)."""
    from rosbags.convert.converter import ConverterError, convert
    from rosbags.typesys import Stores, get_typestore

    jazzy = get_typestore(Stores.ROS2_JAZZY)
    target = jazzy if path.suffix.lower() == '.bag' else None  # a ROS 2 bag keeps its own types
    with tempfile.TemporaryDirectory(prefix='waam_import_') as scratch:
        made = Path(scratch) / 'bag'
        try:
            convert(
                [path],
                made,
                'mcap',
                9,
                compress=None,
                compress_mode='file',
                default_typestore=jazzy,
                typestore=target,
                exclude_topics=(),
                include_topics=(),
                exclude_msgtypes=(),
                include_msgtypes=(),
            )
            found: dict[str, list[tuple[int, bytes]]] = {}
            topics: dict[str, Topic] = {}
            for topic, message in messages(bag_files(made)):
                topics.setdefault(topic.name, topic)
                found.setdefault(topic.name, []).append((message.log_time, message.data))
        except ConverterError as e:
            raise BagError(f'{path}: {e}') from None
    return [Column(replace(topics[n], qos=(QOS,)), rows) for n, rows in found.items()]
