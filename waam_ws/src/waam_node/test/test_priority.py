"""Short turns of the scheduler, in a process of its own: the tests keep theirs."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

CHILD = """
import threading
from pathlib import Path
from waam_node.priority import answer_soon
print(answer_soon({slice_ms}))
def own():
    print(Path(f'/proc/self/task/{{threading.get_native_id()}}/sched').read_text())
t = threading.Thread(target=own)
t.start()
t.join()
"""


@pytest.mark.skipif(
    'se.slice' not in (p.read_text() if (p := Path('/proc/self/sched')).exists() else ''),
    reason='this kernel does not tell the slice of a task (EEVDF, Linux 6.6)',
)
def test_a_thread_that_is_started_later_has_the_short_slice_too():
    out = subprocess.run(
        [sys.executable, '-c', CHILD.format(slice_ms=0.4)],
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert out.stdout.startswith('True'), out
    assert re.search(r'se\.slice\s*:\s*400000\b', out.stdout)


def test_a_system_that_does_not_offer_it_is_no_error(monkeypatch):
    monkeypatch.setattr('platform.machine', lambda: 'abacus')
    from waam_node.priority import answer_soon

    assert answer_soon() is False
