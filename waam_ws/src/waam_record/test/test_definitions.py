"""Definition texts: complete, parseable by a third party, also for types that have no .msg file."""

import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from waam_record.definitions import SEPARATOR, DefinitionError, ament_prefixes, full_text, needs


@pytest.mark.parametrize(
    'name',
    [
        'waam_msgs/msg/Telemetry',
        'waam_msgs/msg/HeightMap',
        'waam_msgs/msg/LayerPlan',
        'sensor_msgs/msg/PointCloud2',
        'diagnostic_msgs/msg/DiagnosticArray',
        'waam_msgs/action/RunJob_FeedbackMessage',
        'action_msgs/msg/GoalStatusArray',
        'rcl_interfaces/msg/ParameterEvent',
    ],
)
def test_every_needed_type_is_in_the_text_once(name):
    text = full_text(name, ament_prefixes())
    sections = text.split(SEPARATOR)
    names = [s.strip().splitlines()[0].removeprefix('MSG: ') for s in sections[1:]]
    assert len(names) == len(set(names))
    types = get_types_from_msg(text, name)
    assert name in types
    store = get_typestore(Stores.EMPTY)
    store.register(types)  # raises when something is missing
    assert store.types[name]


def test_needs_skips_constants_comments_and_primitives():
    text = (
        'uint8 A=1\nfloat32[] z # Foo bar\nHeader h\nstd_msgs/Header[<=3] g\n'
        'string<=4 s\nstring[2] t\nuint8 B =2\n'
    )
    assert needs(text, 'pkg') == ['pkg/msg/Header', 'std_msgs/msg/Header']


def test_feedback_of_the_action_holds_its_status():
    text = full_text('waam_msgs/action/RunJob_FeedbackMessage', ament_prefixes())
    assert 'unique_identifier_msgs/UUID goal_id' in text
    assert 'MSG: waam_msgs/JobStatus' in text


@pytest.mark.parametrize('name', ['nowhere_msgs/msg/X', 'waam_msgs/action/Nothing_Feedback', 'x'])
def test_unknown_type_is_named(name):
    with pytest.raises(DefinitionError, match=name):
        full_text(name, ament_prefixes())
