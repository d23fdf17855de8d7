"""Messages to people: which, how many, to whom; and no secret in anything that is written."""

from __future__ import annotations

import contextlib
import http.server
import json
import threading
import time

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waam_shop.events import ALARM, DONE, KINDS, LOW_WIRE, OUT_OF_TOLERANCE, PAUSED, Event, Watch
from waam_shop.notifier import Notifier, load, send
from waam_shop.notify_settings import (
    EXAMPLE,
    NotifyError,
    NotifySettings,
    Target,
    parse,
    without_secrets,
)  # fmt: skip
from waam_shop.rate import Limits, RateLimit

SECRET = 'hunter2-secret-of-a-webhook'


def alarm(id: int, severity: int = 3, count: int = 1, acknowledged: bool = False) -> dict:
    return {
        'id': id, 'severity': severity, 'count': count, 'acknowledged': acknowledged, 'kind': 'controller',
        'code': '204', 'text': 'bead 3', 'title': 'Arc lost',
    }  # fmt: skip


def kinds(events: list[Event]) -> list[str]:
    return [e.kind for e in events]


def test_the_end_and_the_pause_of_a_job_are_told_once():
    watch = Watch()
    told = [
        watch.job('j1', s, '')
        for s in ('IDLE', 'SCANNING', 'PAUSED', 'PAUSED', 'DEPOSITING', 'DONE', 'DONE')
    ]
    assert [kinds(t) for t in told] == [[], [], [PAUSED], [], [], [DONE], []]
    assert kinds(watch.job('j2', 'FAILED', 'arc lost')) == []  # never seen running: an old one


def test_what_was_there_when_the_panel_started_is_old():
    watch = Watch()
    assert watch.job('j1', 'DONE', '') == [] and watch.alarms([alarm(1)]) == []
    assert kinds(watch.alarms([alarm(1), alarm(2)])) == [ALARM]
    assert watch.alarms([alarm(1), alarm(2)]) == []
    assert kinds(watch.alarms([alarm(1), alarm(2, count=2)])) == [ALARM]
    assert watch.alarms([alarm(3, severity=1), alarm(4, acknowledged=True)]) == []


def test_verdicts_and_wire_are_told_once_each():
    watch = Watch()
    assert kinds(watch.verdict('j1', 'out of tolerance')) == [OUT_OF_TOLERANCE]
    assert watch.verdict('j1', 'out of tolerance') == [] == watch.verdict('j2', 'in tolerance')
    assert watch.wire('j1', 30.0, 20.0) == [] == watch.wire('j1', float('nan'), 20.0)
    assert kinds(watch.wire('j1', 19.0, 20.0)) == [LOW_WIRE] and watch.wire('j1', 5.0, 20.0) == []


@settings(max_examples=60)
@given(
    st.lists(st.tuples(st.floats(0, 900), st.integers(0, 3)), max_size=60),
    st.integers(1, 5),
    st.floats(0, 1000),
)
def test_never_more_than_the_limits_allow(steps, per_hour, repeat):
    limit, now, sent = RateLimit(Limits(per_hour, repeat)), 0.0, []
    for wait, about in steps:
        now += wait
        if limit.allow('alarm', str(about), now):
            sent.append((now, about))
    for n, (at, about) in enumerate(sent):
        assert sum(at - 3600 < t <= at for t, _ in sent[: n + 1]) <= per_hour
        assert all(at - t >= repeat for t, a in sent[:n] if a == about)
    assert limit.held == len(steps) - len(sent)


def test_only_those_who_want_it_are_told_and_held_ones_are_counted():
    said: list[tuple[str, str]] = []
    settings_ = NotifySettings(
        (Target('all', 'json://x'), Target('wire', 'json://y', (LOW_WIRE,))), Limits(10, 600)
    )
    notifier = Notifier(
        settings_, 'cell2', lambda t, title, text: said.append((t.name, text)) or True
    )
    for event in (
        Event(ALARM, 'a', 'first'),
        Event(ALARM, 'a', 'again'),
        Event(LOW_WIRE, 'a', 'low'),
    ):
        notifier.tell(event)
    notifier.close()
    assert [t for t, _ in said] == ['all', 'all', 'wire'] and notifier.sent == 3
    assert '1 other messages were held back' in ' '.join(text for _, text in said)


def test_a_target_that_fails_is_told_by_name_only(monkeypatch):
    monkeypatch.setattr('waam_shop.notifier.AGAIN_S', 0.0)
    target = Target('shift', f'json://127.0.0.1:9/{SECRET}')
    notifier = Notifier(NotifySettings((target,)), 'cell', lambda *_: False)
    notifier.tell(Event(ALARM, 'a', 'x'))
    end = time.monotonic() + 10
    while not notifier.failed and time.monotonic() < end:
        time.sleep(0.01)
    notifier.close()
    assert notifier.problem == "messages: target 'shift' did not take a message"
    assert SECRET not in repr(target) and SECRET not in repr(notifier.settings)


@pytest.fixture
def webhook():
    """(address, requests): a web server of this machine that takes everything."""
    taken: list[tuple[str, dict]] = []

    class Handler(http.server.BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            body = self.rfile.read(int(self.headers['Content-Length']))
            taken.append((self.path, json.loads(body)))
            self.send_response(200)
            self.end_headers()

        def log_message(self, *_: object) -> None:
            pass

    server = http.server.HTTPServer(('127.0.0.1', 0), Handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f'json://127.0.0.1:{server.server_port}/{SECRET}', taken
    server.shutdown()
    server.server_close()


def test_a_message_arrives_by_apprise_and_no_secret_is_written_anywhere(
    webhook, tmp_path, capfd, caplog
):
    """Sends for real, fails for real, and looks for the secret in everything that was printed, logged or stored."""
    address, taken = webhook
    caplog.set_level('DEBUG')
    shop = tmp_path / 'shop'
    shop.mkdir()
    file = shop / 'notify.yaml'
    file.write_text(
        f'targets:\n  - {{name: hook, url: "{address}"}}\n  - {{name: gone, url: "json://127.0.0.1:9/{SECRET}"}}\n'
    )
    file.chmod(0o600)
    settings_ = load(shop)
    assert [send(t, 'cell: test', 'hello') for t in settings_.targets] == [True, False]
    path, body = taken[0]
    assert path.endswith(SECRET) and body['message'] == 'hello' and body['title'] == 'cell: test'
    out = capfd.readouterr()
    assert SECRET not in out.out + out.err + caplog.text
    leaked = without_secrets(f'could not reach {address} ({SECRET})', settings_.targets)
    assert SECRET not in leaked


def test_the_example_is_valid_and_a_file_that_others_can_read_is_refused(tmp_path):
    assert [t.name for t in parse(EXAMPLE).targets] == ['shift']
    file = tmp_path / 'notify.yaml'
    file.write_text(EXAMPLE)
    file.chmod(0o644)
    with pytest.raises(NotifyError, match='chmod 600'):
        load(tmp_path)


@pytest.mark.parametrize(
    'text,word',
    [
        ('targets: [{name: a, url: "x"}]', 'target 1: url'), ('target: []', 'unknown key target'),
        (f'targets: [{{name: a, url: "json://{SECRET}", events: [never]}}]', 'target 1: events'),
        (f'targets: [{{name: a, "json://{SECRET}": 1}}]', r'target 1: unknown key \(hidden\)'),
        (f'url: "json://{SECRET}\n', 'not YAML'), ('per_hour: 0', 'per_hour'), ('per_hour: .nan', 'per_hour'),
        ('[]', 'keys'), (f'- json://{SECRET}', 'keys'),
    ],
)  # fmt: skip
def test_wrong_settings_are_named_without_any_address(text, word):
    with pytest.raises(NotifyError, match=word) as e:
        parse(text)
    assert SECRET not in str(e.value)


@settings(max_examples=80)
@given(st.text(max_size=120))
def test_any_text_is_settings_or_an_error(text):
    with contextlib.suppress(NotifyError):
        assert all(e in KINDS for t in parse(text).targets for e in t.events)
