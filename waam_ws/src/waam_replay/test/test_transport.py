"""The profiles of the middleware for a lock-step replay: a short heartbeat period, and nothing else changed."""

import xml.etree.ElementTree as ElementTree

import pytest

from waam_replay.transport import NAMESPACE, PERIOD_NS, VARIABLE, quick_environment, quick_profiles

GIVEN = f"""<?xml version="1.0"?>
<dds xmlns="{NAMESPACE}"><profiles>
 <participant profile_name="mine" is_default_profile="true"><rtps><name>x</name></rtps></participant>
 <data_writer profile_name="w" is_default_profile="true">
  <topic><historyQos><kind>KEEP_ALL</kind></historyQos></topic>
  <times><heartbeatPeriod><sec>7</sec></heartbeatPeriod></times>
 </data_writer>
</profiles></dds>"""


def texts(text: str, path: str) -> list[str]:
    tree = ElementTree.fromstring(text)
    tags = '/'.join(f'{{{NAMESPACE}}}{p}' for p in path.split('/'))
    return [e.text for e in tree.findall(tags)]


PERIOD = 'profiles/data_writer/times/heartbeatPeriod'


def test_without_profiles_there_is_one_writer_with_a_short_period():
    made = quick_profiles('')
    assert texts(made, f'{PERIOD}/sec') == ['0']
    assert texts(made, f'{PERIOD}/nanosec') == [str(PERIOD_NS)]


def test_what_was_there_stays():
    made = quick_profiles(GIVEN)
    assert texts(made, f'{PERIOD}/sec') == ['0']
    assert texts(made, f'{PERIOD}/nanosec') == [str(PERIOD_NS)]
    assert texts(made, 'profiles/participant/rtps/name') == ['x']
    assert texts(made, 'profiles/data_writer/topic/historyQos/kind') == ['KEEP_ALL']


def test_what_is_no_xml_is_named():
    with pytest.raises(ValueError, match=VARIABLE):
        quick_profiles('<dds>')


def test_the_environment_names_a_file_with_the_profiles(tmp_path):
    given = tmp_path / 'given.xml'
    given.write_text(GIVEN)
    made = quick_environment({VARIABLE: str(given), 'OTHER': '1'}, tmp_path)
    assert list(made) == [VARIABLE]
    with open(made[VARIABLE], encoding='utf-8') as f:
        assert texts(f.read(), f'{PERIOD}/sec') == ['0']
    assert given.read_text() == GIVEN
