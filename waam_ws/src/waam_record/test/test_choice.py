"""Which topics are recorded."""

import pytest

from waam_record.choice import Choice


def test_everything_of_the_namespace_but_what_is_left_out():
    assert Choice().wants('/a') and Choice().wants('/x/_action/feedback')
    assert not Choice('profiles$').wants('/profiles')
    choice = Choice('', '/cell2')
    assert choice.wants('/cell2/telemetry')
    assert not choice.wants('/cell21/telemetry') and not choice.wants('/rosout')


def test_a_wrong_expression_is_named():
    with pytest.raises(ValueError, match=r"parameter 'exclude': '\(' is no regular expression"):
        Choice('(')
