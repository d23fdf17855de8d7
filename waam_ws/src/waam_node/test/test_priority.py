"""Real-time priority: asked for by a variable, inherited by threads, refused without harm."""

import os
import subprocess
import sys

import pytest

from waam_node import priority

SHOW = """
import os, threading
from waam_node import priority
print(priority.take())
print(os.sched_getscheduler(0))
t = threading.Thread(target=lambda: print(os.sched_getscheduler(0)))
t.start(); t.join()
"""


def shown(before: str = '', **variables: str) -> list[str]:
    """What a new process says of itself and of a thread of it."""
    environment = {k: v for k, v in os.environ.items() if k != priority.VARIABLE} | variables
    done = subprocess.run(
        [sys.executable, '-c', before + SHOW], env=environment, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.split('\n')[:3]


def may() -> bool:
    """Whether this account may use real-time priority."""
    program = f'import os; os.sched_setscheduler(0, os.SCHED_RR, os.sched_param({priority.LEVEL}))'
    return subprocess.run([sys.executable, '-c', program], capture_output=True).returncode == 0


def test_nothing_changes_unless_it_is_asked_for():
    assert shown() == ['ordinary', str(os.SCHED_OTHER), str(os.SCHED_OTHER)]
    assert shown(WAAM_REALTIME='0')[0] == 'ordinary'


def test_process_and_its_threads_get_what_the_account_may_have():
    text, process, thread = shown(WAAM_REALTIME='1')
    if may():
        assert (text, process, thread) == ('real time', str(os.SCHED_RR), str(os.SCHED_RR))
    else:
        assert text.startswith('ordinary (real time was refused')
        assert process == thread == str(os.SCHED_OTHER)


@pytest.mark.parametrize('error', ['PermissionError(1, "not permitted")', 'OSError(22, "no")'])
def test_a_refusal_is_named_and_changes_nothing(error):
    deny = f'import os\ndef deny(*_): raise {error}\nos.sched_setscheduler = deny\n'
    text, process, _ = shown(deny, WAAM_REALTIME='1')
    assert text.startswith('ordinary (real time was refused: [Errno')
    assert process == str(os.SCHED_OTHER)
