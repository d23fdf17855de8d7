"""The names are those of the messages."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from waam_process import names
from waam_process.loop_mode import LOOP_MODES

MESSAGES = Path(__file__).parents[2] / 'waam_msgs' / 'msg'


def constants(message: str, prefix: str = '') -> dict[str, int]:
    text = (MESSAGES / f'{message}.msg').read_text()
    found = re.findall(rf'^uint8 {prefix}([A-Z_]+)=(\d+)', text, re.M)
    return {name: int(number) for name, number in found}


@pytest.mark.parametrize(
    'message,prefix,listed',
    [('Telemetry', 'STATE_', names.CONTROLLER_STATES), ('JobStatus', '', names.JOB_STATES)],
)
def test_states_are_the_constants_of_the_messages(message, prefix, listed):
    assert constants(message, prefix) == {name: i for i, name in enumerate(listed)}


@pytest.mark.parametrize(
    'message,field,listed',
    [
        ('Anomaly', 'class_name', names.ANOMALY_CLASSES),
        ('JobStatus', 'profile', LOOP_MODES),
    ],
)
def test_words_are_those_that_the_message_lists(message, field, listed):
    text = (MESSAGES / f'{message}.msg').read_text()
    line = re.search(rf'^string {field}\s+# (.*)', text, re.M)
    assert line and tuple(line[1].split(', ')) == listed


def test_a_number_without_a_name_is_shown_as_it_is():
    assert (names.controller_state(3), names.controller_state(7)) == ('ALARM', '7')
    assert (names.job_state(9), names.job_state(99)) == ('DONE', '99')
    assert 'PAUSED' in names.JOB_RUNNING and not set(names.JOB_ENDED) & set(names.JOB_RUNNING)
