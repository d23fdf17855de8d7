"""No control is reachable from another origin, under another name, or without the token. Real HTTP, no ROS."""

from __future__ import annotations

import asyncio
import http.client
import json
import re
import ssl
from pathlib import Path

import aiohttp
import pytest
from hypothesis import given
from hypothesis import strategies as st

from waam_panel.api import COMMANDS
from waam_panel.security import Denied, Guard, open_tokens, tls_context
from waam_panel.web import ALL_ROUTES
from waam_shop.roles import Role
from waam_shop.token_file import TokenFile

JSON = 'application/json'


def ask(panel, method: str, path: str, body: bytes = b'', **headers: str):
    """(status, headers, body) with exactly these headers ('_' stands for '-')."""
    connection = http.client.HTTPConnection('127.0.0.1', panel.server.port, timeout=20)
    connection.putrequest(method, path, skip_host=True, skip_accept_encoding=True)
    given = {'Host': f'127.0.0.1:{panel.server.port}', 'Content_Length': str(len(body)), **headers}
    for name, value in given.items():
        if value:
            connection.putheader(name.replace('_', '-'), value)
    connection.endheaders(body)
    response = connection.getresponse()
    answer = response.status, dict(response.getheaders()), response.read()
    connection.close()
    return answer


def command(panel, name: str, data: dict | None = None, **headers: str):
    headers = {'Content_Type': JSON, 'X_Waam_Csrf': panel.csrf, 'Origin': panel.url, **headers}
    return ask(panel, 'POST', f'/api/{name}', json.dumps(data or {}).encode(), **headers)


def test_the_page_s_own_request_is_served(panel):
    assert command(panel, 'pause')[0] == 200
    assert panel.operations.asked == [('pause', False)]


FORGED = {
    'another origin': {'Origin': 'http://evil.example'},
    'same name, another port': {'Origin': 'http://127.0.0.1:1'},
    'no origin of its own (sandboxed frame)': {'Origin': 'null'},
    'another site, as the browser says': {'Sec_Fetch_Site': 'cross-site'},
    'another port of this machine, as the browser says': {'Sec_Fetch_Site': 'same-site'},
    'no anti-forgery value': {'X_Waam_Csrf': ''},
    'wrong anti-forgery value': {'X_Waam_Csrf': 'f' * 64},
    'a name that was bound to this machine': {'Host': 'evil.example', 'Origin': 'http://evil.example'},
    'no name': {'Host': ''},
}  # fmt: skip


@pytest.mark.parametrize('forged', FORGED.values(), ids=FORGED)
def test_no_command_is_taken_from_elsewhere(panel, forged):
    for route in ALL_ROUTES:
        if route.method == 'POST' and route.path not in ('/api/stop', '/api/login'):
            status, _, _ = command(panel, route.path.removeprefix('/api/'), **forged)
            assert status in (400, 403, 421), route.path
    assert panel.operations.asked == []


def test_stop_is_refused_from_elsewhere_and_taken_from_an_old_page(panel):
    for name, forged in FORGED.items():
        if 'anti-forgery' not in name:
            status, _, _ = command(panel, 'stop', **forged)
            assert status in (400, 403, 421), name
    assert command(panel, 'stop', Origin='', X_Waam_Csrf='')[0] == 403
    assert panel.operations.asked == []
    assert command(panel, 'stop', X_Waam_Csrf='of the page before the restart')[0] == 200
    assert panel.operations.asked == [('stop',)]


def test_stop_works_as_a_plain_form_without_any_script(panel):
    page = ask(panel, 'GET', '/')[2].decode()
    form = re.search(r'<form id="stop-form" method="post" action="(.*?)">(.*?)</form>', page, re.S)
    csrf = re.search(r'name="csrf" value="(\w+)"', form[2])[1]
    kind = 'application/x-www-form-urlencoded'
    status, headers, _ = ask(panel, 'POST', form[1], f'csrf={csrf}'.encode(), Content_Type=kind)
    assert (status, headers['Location']) == (303, '/')
    assert panel.operations.asked == [('stop',)]


def test_stop_is_not_held_up_by_commands_that_hang(panel):
    panel.operations.hang.clear()

    async def flood() -> int:
        async with aiohttp.ClientSession() as session:
            headers = {'X-Waam-Csrf': panel.csrf, 'Origin': panel.url}

            def post(name: str):
                return session.post(f'{panel.url}/api/{name}', json={}, headers=headers)

            hanging = [asyncio.ensure_future(post('home').__aenter__()) for _ in range(12)]
            await asyncio.sleep(0)
            async with post('stop') as answer:
                status = answer.status
            assert not any(h.done() for h in hanging)
            panel.operations.hang.set()
            await asyncio.gather(*hanging)
            return status

    assert asyncio.run(flood()) == 200


def test_get_changes_nothing_and_files_outside_are_not_served(panel):
    for name in (*COMMANDS, 'stop'):
        assert ask(panel, 'GET', f'/api/{name}')[0] in (404, 405)
    for path in ('/static/../panel_node.py', '/static/%2e%2e%2fapi.py', '/static/x', '/jobs/../x',
                 '/jobs/..%2f..%2fetc/report.html', '/jobs/x/%2e%2e/report.html'):  # fmt: skip
        assert ask(panel, 'GET', path)[0] == 404, path
    assert panel.operations.asked == []


def test_answers_tell_browsers_to_keep_others_out(panel):
    for path in ('/', '/static/panel.js', '/nothing', '/api/choices'):
        headers = ask(panel, 'GET', path)[1]
        policy = headers['Content-Security-Policy']
        assert "default-src 'self'" in policy and "frame-ancestors 'none'" in policy
        assert (
            headers['X-Frame-Options'] == 'DENY' and headers['X-Content-Type-Options'] == 'nosniff'
        )
        assert 'Access-Control-Allow-Origin' not in headers


def stream(panel, **headers: str) -> int:
    """Status of a WebSocket's start (101 = open)."""

    async def go() -> int:
        async with aiohttp.ClientSession(cookie_jar=aiohttp.DummyCookieJar()) as session:
            try:
                async with session.ws_connect(f'{panel.url}/stream', headers=headers) as socket:
                    frame = await socket.receive_json(timeout=20)
                    assert frame['boot'] == panel.cell.boot
                    return 101
            except aiohttp.WSServerHandshakeError as e:
                return e.status

    return asyncio.run(go())


def test_the_stream_opens_for_our_own_page_only(panel):
    assert stream(panel, Origin=panel.url) == 101
    assert stream(panel, Origin='http://evil.example') == 403
    assert stream(panel) == 403
    assert stream(panel, Origin='http://evil.example', Host='evil.example') == 421


# ---- with a token


@pytest.fixture
def locked(make_panel):
    return make_panel(tokens=True, hosts=('cell-3.local',))


def sign_in(panel, token: str = '', **headers: str):
    token = token or panel.tokens['operate']
    kind = 'application/x-www-form-urlencoded'
    headers = {'Origin': panel.url, 'Content_Type': kind, **headers}
    return ask(panel, 'POST', '/api/login', f'token={token.replace(" ", "+")}'.encode(), **headers)


def test_without_the_token_there_is_only_the_door(locked):
    for path in ('/api/choices', '/api/jobs', '/api/map/height', '/api/preview.png', '/static/panel.js',
                 '/jobs/x/report.html'):  # fmt: skip
        assert ask(locked, 'GET', path)[0] == 401, path
    assert ask(locked, 'GET', '/')[0] == 303
    assert ask(locked, 'GET', '/login')[0] == 200
    assert stream(locked, Origin=locked.url) == 401
    for name in (*COMMANDS, 'stop', 'parts'):
        assert command(locked, name)[0] == 401, name
    assert locked.operations.asked == []


def test_the_token_opens_and_its_cookie_is_kept_from_scripts_and_other_sites(locked):
    assert sign_in(locked, 'a wrong token')[0] == 401
    assert sign_in(locked, Origin='http://evil.example')[0] == 403
    status, headers, _ = sign_in(locked)
    assert status == 303 and headers['Location'] == '/'
    cookie = headers['Set-Cookie']
    assert 'HttpOnly' in cookie and 'SameSite=Strict' in cookie
    session = cookie.split(';')[0]
    page = ask(locked, 'GET', '/', Cookie=session)[2].decode()
    csrf = re.search(r'name="csrf" content="(\w+)"', page)[1]
    assert command(locked, 'home', Cookie=session, X_Waam_Csrf=csrf)[0] == 200
    assert command(locked, 'home', Cookie=session, X_Waam_Csrf='')[0] == 403
    assert command(locked, 'home', X_Waam_Csrf=csrf)[0] == 401
    assert stream(locked, Origin=locked.url, Cookie=session) == 101
    named = {'Host': f'cell-3.local:{locked.server.port}'}
    named['Origin'] = f'http://{named["Host"]}'
    assert command(locked, 'home', Cookie=session, X_Waam_Csrf=csrf, **named)[0] == 200


@pytest.fixture
def tokens(tmp_path) -> TokenFile:
    return TokenFile(tmp_path / 'tokens.json')


def test_sessions_survive_a_restart_run_out_and_end_with_their_token(tokens, monkeypatch):
    token = tokens.create('tablet', Role.OPERATE)
    first = Guard.create(tokens, '127.0.0.1', 1)
    cookie, who = first.login(token)
    assert (who.who, who.role) == ('tablet', Role.OPERATE)
    again = Guard.create(TokenFile(tokens.path), '127.0.0.1', 2)
    assert again.visitor(cookie) == who and again.csrf(cookie) == first.csrf(cookie)
    id, ends, signature = cookie.split('.')
    for forged in (
        f'{id}.{int(ends) + 1}.{signature}',
        f'00000000.{ends}.{signature}',
        cookie[:-1],
    ):
        assert again.visitor(forged) is None
    with monkeypatch.context() as later:
        later.setattr('time.time', lambda: int(ends) + 1.0)
        assert again.visitor(cookie) is None
    tokens.create('other', Role.VIEW)
    TokenFile(tokens.path).revoke('tablet')
    assert again.visitor(cookie) is None and first.visitor(cookie) is None


@given(text=st.text(max_size=80))
def test_no_made_up_cookie_or_token_opens(made_tokens, text):
    guard = Guard.create(made_tokens, '127.0.0.1', 1)
    assert guard.visitor(text) is None
    with pytest.raises(Denied):
        guard.login(text)


@pytest.fixture(scope='module')
def made_tokens(tmp_path_factory) -> TokenFile:
    tokens = TokenFile(tmp_path_factory.mktemp('tokens') / 'tokens.json')
    tokens.create('tablet', Role.MAINTAIN)
    return tokens


def test_other_addresses_need_tokens_and_tls(tokens):
    assert open_tokens('', '127.0.0.1', False) is None and open_tokens('', '::1', False) is None
    file = str(tokens.path)
    with pytest.raises(ValueError, match='No such file .waam token create'):
        open_tokens(file, '127.0.0.1', False)
    tokens.create('tablet', Role.VIEW)
    tokens.revoke('tablet')
    with pytest.raises(ValueError, match='holds no token'):
        open_tokens(file, '127.0.0.1', False)
    tokens.create('tablet', Role.VIEW)
    for bind in ('0.0.0.0', '192.168.1.5', '::', 'cell-3.local'):
        with pytest.raises(ValueError, match="'token_file' .* and 'tls_cert'"):
            open_tokens('', bind, True)
        with pytest.raises(ValueError, match="'tls_cert' and 'tls_key'"):
            open_tokens(file, bind, False)
        assert open_tokens(file, bind, True)
    tokens.path.chmod(0o644)
    with pytest.raises(ValueError, match='chmod 600'):
        open_tokens(file, '0.0.0.0', True)
    tokens.path.chmod(0o600)
    tokens.path.write_text('the token of an earlier version')
    with pytest.raises(ValueError, match='waam token create'):
        open_tokens(file, '0.0.0.0', True)


def test_with_certificate_files_everything_is_encrypted(make_panel, certificate):
    panel = make_panel(tokens=True, tls=tls_context(*certificate))
    port = panel.server.port
    trusted = ssl.create_default_context(cafile=certificate[0])
    connection = http.client.HTTPSConnection('127.0.0.1', port, timeout=20, context=trusted)
    body, kind = f'token={panel.tokens["view"]}', 'application/x-www-form-urlencoded'
    origin = f'https://127.0.0.1:{port}'
    connection.request('POST', '/api/login', body, {'Origin': origin, 'Content-Type': kind})
    answer = connection.getresponse()
    assert answer.status == 303 and 'Secure' in answer.headers['Set-Cookie']
    with pytest.raises((http.client.HTTPException, OSError)):
        ask(panel, 'GET', '/')
    old = ssl.create_default_context(cafile=certificate[0])
    old.maximum_version = ssl.TLSVersion.TLSv1_1
    with pytest.raises(OSError):
        http.client.HTTPSConnection('127.0.0.1', port, timeout=20, context=old).request('GET', '/')


def test_certificate_files_that_cannot_be_used_are_named(certificate, tmp_path):
    cert, key = certificate
    assert tls_context('', '') is None
    open_key = tmp_path / 'open.pem'
    open_key.write_bytes(Path(key).read_bytes())
    open_key.chmod(0o644)
    for pair, word in (
        ((cert, ''), 'belong together'), ((cert, str(tmp_path / 'no')), 'tls_key.*no such file'),
        ((key, key), 'tls_cert'), ((cert, str(open_key)), 'chmod 600'),
    ):  # fmt: skip
        with pytest.raises(ValueError, match=word):
            tls_context(*pair)
