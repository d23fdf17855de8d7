"""Files: third-party reading, splits, damage, recovery."""

import json

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from waam_record.bag_copy import recover
from waam_record.bag_reader import info
from waam_record.bag_writer import BagError, BagWriter, Topic
from waam_record.definitions import ament_prefixes, full_text
from waam_record.log_column import QOS

TELEMETRY, MAP = 'waam_msgs/msg/Telemetry', 'waam_msgs/msg/HeightMap'


def installed_hash(name):
    """The type hash that rosidl installed; rosbags compares it with the definition text."""
    package, kind, base = name.split('/')
    for prefix in ament_prefixes():
        file = prefix / 'share' / package / kind / f'{base.removesuffix("_Event")}.json'
        if file.is_file():
            hashes = json.loads(file.read_text())['type_hashes']
            return next(h['hash_string'] for h in hashes if h['type_name'] == name)
    raise AssertionError(name)


HASH = installed_hash(TELEMETRY)


def definition(name):
    return full_text(name, ament_prefixes())


@pytest.fixture(scope='module')
def store():
    """Types as rosbags reads them from our own definition texts."""
    s = get_typestore(Stores.EMPTY)
    for name in (TELEMETRY, MAP):
        fresh = get_types_from_msg(definition(name), name)
        s.register({k: v for k, v in fresh.items() if k not in s.fielddefs})
    return s


def header(store, t):
    stamp = store.types['builtin_interfaces/msg/Time'](t // 10**9, t % 10**9)
    return store.types['std_msgs/msg/Header'](stamp, 'work')


def telemetry(store, i):
    point = store.types['geometry_msgs/msg/Point'](0.1, 0.2, i * 1e-3)
    msg = store.types[TELEMETRY](
        header=header(store, i * 10**7), controller_us=i * 10_000, boot_id=3, sequence=i, state=1, position=point,
        travel_speed=0.01, wire_feed_commanded=0.08, wire_feed_speed=0.081, arc_current=180.0 + i, arc_voltage=22.0,
        arc_enabled=True, arc_established=True, gas=True, wire_feed=1, line_accepted=i, line_executed=i,
        blocks_free=40, speed_override=1.0, wire_override=1.0, lease_left=0.4, underruns=0, fault=0,
    )  # fmt: skip
    return bytes(store.serialize_cdr(msg, TELEMETRY))


def height_map(store, k):
    t = store.types
    pose = t['geometry_msgs/msg/Pose'](
        t['geometry_msgs/msg/Point'](0.0, 0.0, 0.0), t['geometry_msgs/msg/Quaternion'](0, 0, 0, 1)
    )
    z = np.linspace(0, k, 12, dtype=np.float32)
    z[3] = np.nan
    msg = t[MAP](
        header=header(store, k), job_id='job', scan_id=k, layer=k,
        grid=t['waam_msgs/msg/GridInfo'](5e-4, 3, 4, pose), z=z, sigma=z * 0.1,
        count=np.arange(12, dtype=np.uint16), coverage=0.9, plausible=True, reasons=['good', 'seen'],
        profiles_used=1, profiles_rejected=2, points_used=3, points_rejected=4, residual=5e-5,
        bead_width=6e-3, bead_width_u=2e-4, bead_width_expected=6.2e-3, bead_width_sections=12,
    )  # fmt: skip
    return bytes(store.serialize_cdr(msg, MAP))


def write(folder, store, count=200, split_at=(), flush_every=50, close=True):
    writer = BagWriter(folder, {'material': 'ER70S-6'})
    tele = writer.add_topic(Topic('/telemetry', TELEMETRY, definition(TELEMETRY), HASH, (QOS,)))
    maps = writer.add_topic(Topic('/height_map', MAP, definition(MAP), '', (QOS,), latched=True))
    for i in range(count):
        t = 10**18 + i * 10**7
        writer.write(tele, t, t - 5000, i + 1, telemetry(store, i))
        if i % 40 == 0:
            writer.write(maps, t, t, i, height_map(store, i))
        if i % flush_every == flush_every - 1:
            writer.flush()
        if i in split_at:
            writer.split()
    if close:
        writer.close()
    return writer


def test_rosbags_reads_what_was_written(tmp_path, store):
    write(tmp_path / 'record', store)
    with AnyReader([tmp_path / 'record'], default_typestore=get_typestore(Stores.EMPTY)) as reader:
        assert reader.message_count == 205
        assert reader.topics['/telemetry'].msgcount == 200
        assert reader.topics['/telemetry'].msgtype == TELEMETRY
        times, currents, maps = [], [], []
        for connection, t, raw in reader.messages():
            msg = reader.deserialize(raw, connection.msgtype)
            if connection.topic == '/telemetry':
                times.append(t)
                currents.append(msg.arc_current)
            else:
                maps.append(msg)
    assert times == [10**18 + i * 10**7 for i in range(200)]
    assert currents == [180.0 + i for i in range(200)]
    assert np.isnan(maps[1].z[3]) and maps[1].z[11] == 40 and maps[1].reasons == ['good', 'seen']
    assert list(maps[4].count) == list(range(12))


def test_metadata_has_every_field_that_rosbag2_reads(tmp_path, store):
    write(tmp_path / 'record', store, split_at=(99,))
    bag = yaml.safe_load((tmp_path / 'record/metadata.yaml').read_text())[
        'rosbag2_bagfile_information'
    ]
    assert bag['version'] == 9 and bag['storage_identifier'] == 'mcap'
    assert bag['relative_file_paths'] == ['record_0.mcap', 'record_1.mcap']
    assert [f['path'] for f in bag['files']] == bag['relative_file_paths']
    assert sum(f['message_count'] for f in bag['files']) == bag['message_count'] == 206
    assert bag['starting_time']['nanoseconds_since_epoch'] == 10**18
    assert bag['duration']['nanoseconds'] == 199 * 10**7
    assert bag['custom_data'] == {'material': 'ER70S-6'}
    topic = bag['topics_with_message_count'][0]['topic_metadata']
    assert topic['offered_qos_profiles'] == [QOS] and topic['type_description_hash'] == HASH
    assert {'compression_format', 'compression_mode', 'ros_distro'} <= bag.keys()


def test_records_inside_the_file(tmp_path, store):
    write(tmp_path / 'record', store)
    with open(tmp_path / 'record/record_0.mcap', 'rb') as f:
        reader = make_reader(f)
        assert reader.get_header().profile == 'ros2'
        summary = reader.get_summary()
        channel = next(c for c in summary.channels.values() if c.topic == '/telemetry')
        assert channel.message_encoding == 'cdr' and channel.metadata['topic_type_hash'] == HASH
        assert yaml.safe_load(channel.metadata['offered_qos_profiles']) == [QOS]
        schema = summary.schemas[channel.schema_id]
        assert (schema.name, schema.encoding) == (TELEMETRY, 'ros2msg')
        assert {i.compression for i in summary.chunk_indexes} == {'zstd'}
        stated = [yaml.safe_load(m.metadata['serialized_metadata']) for m in reader.iter_metadata()]
        assert [s['message_count'] for s in stated] == [0, 205]
        _, _, message = next(reader.iter_messages(topics=['/telemetry']))
        assert (message.sequence, message.publish_time) == (1, 10**18 - 5000)


def test_service_events_keep_their_hash_where_rosbags_does_not_look(tmp_path, store):
    """With it in metadata.yaml rosbags refuses to open the whole recording."""
    kind = 'waam_msgs/srv/BeginScan_Event'
    event_hash = installed_hash(kind)
    writer = BagWriter(tmp_path / 'record')
    topic = writer.add_topic(
        Topic('/begin/_service_event', kind, definition(kind), event_hash, (QOS,))
    )
    writer.write(topic, 10**18, 10**18, 1, bytes(8))
    writer.close()
    with open(tmp_path / 'record/record_0.mcap', 'rb') as f:
        reader = make_reader(f)
        channel = next(iter(reader.get_summary().channels.values()))
        assert channel.metadata['topic_type_hash'] == event_hash
        stated = [yaml.safe_load(m.metadata['serialized_metadata']) for m in reader.iter_metadata()]
        described = stated[-1]['topics_with_message_count'][0]['topic_metadata']
        assert described['type_description_hash'] == event_hash
    with AnyReader([tmp_path / 'record']) as reader:
        assert [(c.topic, raw) for c, _, raw in reader.messages()] == [
            ('/begin/_service_event', bytes(8))
        ]


def test_latched_messages_are_repeated_after_a_split(tmp_path, store):
    write(tmp_path / 'record', store, split_at=(99,))
    with AnyReader([tmp_path / 'record/record_1.mcap']) as reader:
        first = [t for c, t, _ in reader.messages() if c.topic == '/height_map'][0]
        assert first == 10**18 + 99 * 10**7
    with AnyReader([tmp_path / 'record']) as reader:
        assert reader.topics['/telemetry'].msgcount == 200


def test_an_existing_folder_is_refused(tmp_path):
    with pytest.raises(BagError, match='exists already'):
        BagWriter(tmp_path)


def test_file_without_end_keeps_all_flushed_messages(tmp_path, store):
    """What a kill leaves: nothing is finished, the last flush counts."""
    writer = write(tmp_path / 'record', store, count=75, flush_every=50, close=False)
    listed = info(tmp_path / 'record')
    assert listed.topics['/telemetry'].messages == 50
    assert recover(tmp_path / 'record', tmp_path / 'saved').messages == 52
    writer.close()


def test_zeros_at_the_end_of_a_file(tmp_path, store):
    """A power cut can leave a tail of zeros."""
    writer = write(tmp_path / 'record', store, count=50, flush_every=50, close=False)
    file = tmp_path / 'record/record_0.mcap'
    damaged = tmp_path / 'damaged_0.mcap'
    damaged.write_bytes(file.read_bytes() + bytes(5000))
    assert recover(damaged, tmp_path / 'saved').messages == 52
    writer.close()


def test_no_recording_there(tmp_path):
    with pytest.raises(BagError, match='no .mcap file'):
        info(tmp_path)
