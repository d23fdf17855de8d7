"""Nobody who may not ask makes the panel work: bodies are not read before the sender is known, and never more than the
route allows. STOP from another connection works meanwhile. No ROS."""

from __future__ import annotations

import contextlib
import json
from pathlib import Path

import pytest
from panel_client import Client, post, stops

from waam_panel import bodies
from waam_panel.web import ALL_ROUTES

POSTS = sorted(
    r.path.replace('{name}', 'height') for r in ALL_ROUTES if r.method == 'POST'
)  # every one
LARGE = 8 << 20
FORM = 'application/x-www-form-urlencoded'
KINDS = (FORM, 'application/json', 'multipart/form-data; boundary=x', 'text/plain')


@pytest.fixture
def locked(make_panel):
    return make_panel(tokens=True)


@pytest.mark.parametrize('chunked', [False, True], ids=['length', 'chunked'])
def test_no_body_of_a_stranger_is_read(locked, chunked):
    """On every route and for every kind of body, the answer comes while the first byte of it is still to be sent."""
    size = {'Transfer_Encoding': 'chunked'} if chunked else {'Content_Length': str(LARGE)}
    for path in POSTS:
        for kind in KINDS:
            client = Client(locked)
            client.head('POST', path, Origin=locked.url, Content_Type=kind, **size)
            if path == '/api/login' and chunked:
                client.socket.sendall(b'1000\r\n' + bytes(0x1000) + b'\r\n')
            status, _ = client.answer()
            wanted = (413, 401) if path == '/api/login' else (401,)
            assert status in wanted, (path, kind)
            client.close()
    stops(locked)
    assert [a for a in locked.operations.asked if a != ('stop',)] == []


@pytest.mark.parametrize('chunked', [False, True], ids=['length', 'chunked'])
@pytest.mark.parametrize(
    'forged',
    [{'Origin': 'http://evil.example'}, {'Sec_Fetch_Site': 'cross-site'}, {'Host': 'evil.example'}],
    ids=['origin', 'site', 'host'],
)
def test_no_body_from_another_site_is_read(panel, forged, chunked):
    """The browser of the cell's computer itself sends it; no session is needed there."""
    size = {'Transfer_Encoding': 'chunked'} if chunked else {'Content_Length': str(LARGE)}
    for path in POSTS:
        client = Client(panel)
        client.head('POST', path, **{'Origin': panel.url, 'Content_Type': FORM, **size, **forged})
        assert client.answer()[0] in (403, 421), path
        client.close()
    stops(panel)
    assert [a for a in panel.operations.asked if a != ('stop',)] == []


def test_while_a_large_body_arrives_others_are_served(locked):
    """Eight strangers pour 8 MB each into the panel; between their pieces STOP is answered."""
    pouring = [Client(locked) for _ in range(8)]
    for n, client in enumerate(pouring):
        path = POSTS[n % len(POSTS)]
        client.head('POST', path, Origin=locked.url, Content_Type=FORM, Content_Length=str(LARGE))
    piece = b'a=1&' * 16384
    for _ in range(LARGE // len(piece) // 16):
        for client in pouring:
            with contextlib.suppress(OSError):
                client.socket.settimeout(0.05)
                client.socket.sendall(piece)
        stops(locked)
    for client in pouring:
        client.close()


@pytest.mark.parametrize('chunked', [False, True], ids=['length', 'chunked'])
def test_every_route_has_a_limit_for_those_who_may_ask(panel, chunked):
    """One byte more than allowed is refused by name, announced or not; what is allowed is taken."""
    csrf = {'X_Waam_Csrf': panel.csrf, 'Origin': panel.url, 'Content_Type': 'application/json'}
    for path in POSTS:
        route = next(r for r in ALL_ROUTES if r.path == path and r.method == 'POST')
        limit = panel.cell.upload_bytes if route.body < 0 else route.body
        client = Client(panel)
        body = b'"' + b'x' * (limit - 1) + b'"'
        if path in ('/api/login', '/api/stop'):
            headers = csrf | {'Content_Type': FORM}
            if path == '/api/stop':
                headers |= {'X_Waam_Csrf': '', 'Origin': ''}  # then the form is read
        else:
            headers = csrf
        if chunked:
            client.head('POST', path, Transfer_Encoding='chunked', **headers)
            with contextlib.suppress(OSError):
                client.socket.sendall(b'%x\r\n' % len(body) + body + b'\r\n0\r\n\r\n')
        else:
            client.head('POST', path, Content_Length=str(len(body)), **headers)
        status, said = client.answer()
        assert status == 413 and str(bodies.FORM if limit < 1000 else 'longer') in said.decode(), (
            path
        )
        client.close()
    assert panel.operations.asked == []


def test_a_body_of_the_allowed_length_is_taken_in_chunks_as_well(panel):
    data = json.dumps({'mm': 5.0}).encode().ljust(bodies.COMMAND - 40)
    client = Client(panel)
    client.head(
        'POST', '/api/jog_wire', Origin=panel.url, X_Waam_Csrf=panel.csrf,
        Content_Type='application/json', Transfer_Encoding='chunked',
    )  # fmt: skip
    for k in range(0, len(data), 1000):
        piece = data[k : k + 1000]
        client.socket.sendall(b'%x\r\n' % len(piece) + piece + b'\r\n')
    client.socket.sendall(b'0\r\n\r\n')
    assert client.answer()[0] == 200
    client.close()


def test_packed_bodies_are_not_unpacked(panel):
    for packed in ('gzip', 'deflate', 'br', 'x'):
        assert post(panel, 'home', Content_Encoding=packed)[0] == 415


@pytest.mark.parametrize(
    'text', ['[' * 60_000, '{"a":' * 10_000, '9' * 5000, '{"mm":' + '9' * 4400 + '}']
)
def test_json_that_is_too_deep_or_too_long_is_refused_by_name(panel, text):
    status, said = post(panel, 'jog_wire', text.encode())
    assert status == 400 and b'JSON' in said


def test_a_form_that_never_comes_ends_in_time(panel, monkeypatch):
    monkeypatch.setattr(bodies, 'PATIENCE_S', 0.3)
    client = Client(panel)
    client.head('POST', '/api/stop', Content_Type=FORM, Content_Length='100')
    assert client.answer()[0] == 408
    client.close()
    assert panel.operations.asked == []


def test_a_page_of_another_site_makes_the_panel_read_nothing(panel):
    """Lists are files and threads; a link that somebody follows is let through."""
    for mode, status in (('no-cors', 403), ('cors', 403), ('websocket', 403), ('navigate', 200)):
        for path in ('/api/jobs', '/api/audit', '/api/archive', '/'):
            client = Client(panel)
            client.head('GET', path, Sec_Fetch_Site='cross-site', Sec_Fetch_Mode=mode)
            assert client.answer()[0] == status, (mode, path)
            client.close()


def test_nothing_but_bodies_reads_a_body():
    """So that no route forgets its limit."""
    folder = Path(bodies.__file__).parent
    for file in folder.glob('*.py'):
        text = file.read_text()
        for call in (
            'request.post(',
            'request.read(',
            'request.text(',
            'request.json(',
            'request.multipart(',
        ):
            assert call not in text, (file.name, call)
        assert ('request.content' in text.replace('request.content_', '')) <= (
            file.name in ('bodies.py', 'web.py')
        ), file.name
