"""Foreign recordings into MCAP: ROS 1 bags and SQLite bags (read by `rosbags`) and pyrometer files, which say
themselves what they hold. Logs with columns: `foreign`."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from .bag_copy import Selection
from .bag_writer import BagError, BagWriter, Topic
from .import_pyrometer import is_pyrometer, read_pyrometer
from .log_column import QOS, Column

Progress = Callable[[int], None]
BAGS = ('.bag', '.db3')


def known(path: Path) -> bool:
    """Whether a file says itself what it holds."""
    return path.is_dir() or path.suffix.lower() in BAGS or is_pyrometer(path)


def read_known(path: Path) -> list[Column]:
    """Topics of a bag or a pyrometer file. BagError names file and line."""
    if not path.exists():
        raise BagError(f'{path}: no such file')
    if path.is_dir() or path.suffix.lower() in BAGS:
        return read_bag(path)
    if is_pyrometer(path):
        return read_pyrometer(path)
    raise BagError(f'{path}: neither of {", ".join(BAGS)}, a bag folder nor a pyrometer file')


def import_logs(paths: list[Path], output: Path, progress: Progress = lambda n: None) -> int:
    """Writes bags and pyrometer files as one recording, by time; returns the number of messages. BagError names file
    and line."""
    columns = [c for path in paths for c in read_known(path)]
    return write(columns, output, [p.name for p in paths], progress)


def write(
    columns: list[Column], output: Path, sources: list[str], progress: Progress = lambda n: None
) -> int:
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
    for n, (stamp, number, data) in enumerate(rows):
        sequences[number] += 1
        writer.write(numbers[number], stamp, stamp, sequences[number], data)
        if n % 1000 == 999:
            progress(1000)
    writer.close()
    return writer.messages


def read_bag(path: Path, selection: Selection = Selection()) -> list[Column]:
    """Topics of a ROS 1 bag or of any ROS 2 bag that `rosbags` opens, as ROS 2 messages: types of the standard packages
    get their ROS 2 definition (no `seq` in headers)."""
    from rosbags.highlevel import AnyReader
    from rosbags.highlevel.anyreader import AnyReaderError
    from rosbags.typesys import Stores, get_typestore

    from .ros1 import Converter

    found: dict[str, list[tuple[int, bytes]]] = {}
    topics: dict[str, Topic] = {}
    try:
        with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
            converter = Converter(reader.typestore, reader.is2)
            for connection, stamp, raw in reader.messages():
                name = (
                    connection.topic if connection.topic.startswith('/') else f'/{connection.topic}'
                )
                if not selection.wants(name):
                    continue
                if name not in topics:
                    text, type_hash = converter.definition(connection.msgtype)
                    topics[name] = Topic(name, connection.msgtype, text, type_hash, (QOS,))
                found.setdefault(name, []).append((stamp, converter.cdr(raw, connection.msgtype)))
    except AnyReaderError as e:
        raise BagError(f'{path}: {e}') from None
    return [Column(topic, found[name]) for name, topic in topics.items()]
