"""Which topics are recorded."""

import pytest

from waam_record.choice import Choice, ChoiceError

TEMPERATURE = ['sensor_msgs/msg/Temperature']
STRING = ['std_msgs/msg/String']


def test_everything_by_default_hidden_topics_included():
    assert Choice().wants('/a', STRING)
    assert Choice().wants('/x/_action/feedback', STRING)


def test_name_regex_or_type_choose():
    choice = Choice(topics='/a /b', regex='^/map', types='sensor_msgs/msg/Temperature')
    assert choice.wants('/a', STRING) and choice.wants('/map_1', STRING)
    assert choice.wants('/anything', TEMPERATURE)
    assert not choice.wants('/c', STRING)


def test_exclusion_wins():
    assert not Choice(topics='/a', exclude='a').wants('/a', STRING)


def test_a_wrong_expression_is_named():
    with pytest.raises(ChoiceError, match=r"parameter 'regex': '\(' is no regular expression"):
        Choice(regex='(')


def test_of_another_namespace_only_what_is_named_is_taken():
    choice = Choice(below='/cell2')
    assert choice.wants('/cell2/telemetry', STRING)
    assert not choice.wants('/cell21/telemetry', STRING) and not choice.wants('/rosout', STRING)
    assert Choice(topics='/rosout', below='/cell2').wants('/rosout', STRING)
