"""Tokens hold only hashes and are compared whole; the audit log shows every change; any bytes are read safely."""

from __future__ import annotations

import contextlib
import hmac
import json
import os
from dataclasses import replace

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from waam_node.locks import locked
from waam_shop.audit import (
    BYTES,
    CUT,
    FIRST,
    LEFT_OUT,
    AuditError,
    Entry,
    clean,
    hidden,
    parse,
    verify,
)
from waam_shop.audit_file import AuditLog
from waam_shop.queue_file import QueueFile
from waam_shop.roles import Role
from waam_shop.token_file import TokenFile
from waam_shop.tokens import Token, TokenBook, TokenError, digest, shown

SECRET = 'A' * 43


def book(**of) -> TokenBook:
    values = {
        'id': '0123abcd',
        'name': 'tablet',
        'role': 'operate',
        'sha256': digest(SECRET),
        'created': 1.0,
    }
    return TokenBook((Token(**(values | of)),))


def test_only_hashes_are_stored_and_only_for_their_owner(tmp_path):
    file = TokenFile(tmp_path / 'tokens.json')
    token = file.create('tablet', Role.OPERATE)
    stored = file.path.read_text()
    assert token not in stored and token.split('_', 2)[2] not in stored
    assert file.path.stat().st_mode & 0o777 == 0o600
    found = file.book().check(token, 10.0)
    assert found and (found.name, found.rights) == ('tablet', Role.OPERATE)
    file.path.chmod(0o644)
    with pytest.raises(TokenError, match='chmod 600'):
        file.book()


def test_a_revoked_token_is_out_at_once_for_a_reader_that_has_the_file_open(tmp_path):
    reader = TokenFile(tmp_path / 'tokens.json')
    first = TokenFile(reader.path).create('a', Role.VIEW)
    second = TokenFile(reader.path).create('b', Role.VIEW)
    assert reader.book().check(first, 1.0) and reader.book().check(second, 1.0)
    TokenFile(reader.path).revoke('a')
    assert reader.book().check(first, 1.0) is None and reader.book().check(second, 1.0)
    with pytest.raises(TokenError, match="no token 'a'"):
        TokenFile(reader.path).revoke('a')


def test_a_token_runs_out_and_its_name_is_free_again():
    expired = book(expires=5.0)
    assert expired.check(shown('0123abcd', SECRET), 4.0)
    assert expired.check(shown('0123abcd', SECRET), 5.0) is None
    assert len(expired.add(replace(expired.tokens[0], id='0123abce'), 6.0).tokens) == 2
    with pytest.raises(TokenError, match='already'):
        expired.add(replace(expired.tokens[0], id='0123abce'), 4.0)


def test_every_check_compares_digests_in_constant_time(monkeypatch):
    compared = []
    real = hmac.compare_digest
    monkeypatch.setattr('hmac.compare_digest', lambda a, b: compared.append((a, b)) or real(a, b))
    for given_token in (shown('0123abcd', SECRET), shown('ffffffff', SECRET), '', 'x'):
        book().check(given_token, 1.0)
    assert len(compared) == 4 and all(len(a) == len(b) == 64 for a, b in compared)


@given(st.text(max_size=80))
@example(shown('0123abcd', ''))
@example(f' {shown("0123abcd", SECRET[:-1])}')
@example(f'xaam_0123abcd_{SECRET}')
def test_no_other_text_is_the_token(text):
    assert book().check(text, 1.0) is None or text.strip() == shown('0123abcd', SECRET)


VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=12),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=6), inner, max_size=4),
    max_leaves=6,
)  # fmt: skip


@settings(max_examples=120)
@given(st.text(max_size=120), st.sampled_from(sorted(Token.__dataclass_fields__)), VALUES)
def test_any_file_of_tokens_is_read_or_refused(text, name, value):
    good = json.loads(book().text())
    good['tokens'][0][name] = value
    for t in (text, json.dumps(good), json.dumps({'version': 1, 'tokens': value}), '[' * 100_000):
        try:
            for token in TokenBook.parse(t).tokens:
                assert token.rights in Role and token.valid(0.0) in (True, False)
        except TokenError:
            pass


def test_a_plain_token_in_the_file_is_told_what_to_do():
    with pytest.raises(TokenError, match='waam token create'):
        TokenBook.parse('my old secret token\n')


# ---- audit log


@pytest.fixture
def log(tmp_path) -> AuditLog:
    log = AuditLog(tmp_path, 'cell2')
    for n in range(6):
        log.write('jog', 'tablet', 'panel', role='operate', data={'axis': 'x', 'step': n})
    return log


def rewrite(log: AuditLog, change) -> list[str]:
    lines = log.path.read_bytes().splitlines(keepends=True)
    log.path.write_bytes(b''.join(change(lines)))
    return log.verify().problems


def test_an_untouched_log_is_whole_and_says_who_did_what(log):
    found = log.verify()
    assert found.good and (found.entries, found.last_n) == (6, 6)
    assert log.last(2)[-1].data == {'axis': 'x', 'step': 5}
    assert log.verify(expect=log.last(3)[0].hash).good
    assert not log.verify(expect='f' * 64).good


@pytest.mark.parametrize(
    'change,word',
    [
        (lambda s: [s[0].replace(b'"axis":"x"', b'"axis":"y"'), *s[1:]], 'entry 1 was changed'),
        (lambda s: [*s[:2], *s[3:]], 'entry 4 does not follow entry 2'),
        (lambda s: [s[1], s[0], *s[2:]], 'does not follow'),
        (lambda s: s[:4], 'cut off: the head file knows entry 6, the log ends with 4'),
        (lambda s: [*s, s[0]], 'entry 1 does not follow'),
        (lambda s: [*s[:3], b'nothing\n', *s[3:]], 'line 4: damaged'),
        (lambda s: [], 'cut off'),
    ],
)  # fmt: skip
def test_what_was_changed_left_out_moved_or_cut_off_is_found(log, change, word):
    assert word in '; '.join(rewrite(log, change))


def test_writing_on_after_a_cut_does_not_hide_it(log):
    rewrite(log, lambda lines: lines[:3])
    log.write('home', 'local', 'panel')
    problems = '; '.join(log.verify().problems)
    assert '3 entries before 7 are missing' in problems


def test_a_rewritten_chain_is_found_with_a_hash_that_was_kept_elsewhere(log, tmp_path):
    kept = log.verify().last
    for file in (log.path, log.head):
        file.unlink()
    log.write('nothing happened', 'local', 'panel')
    assert log.verify().good and not log.verify(expect=kept).good


def test_a_line_that_a_power_cut_left_is_told_and_is_no_forgery(log):
    whole = log.path.read_bytes()
    log.path.write_bytes(whole + whole.splitlines()[-1][:50])
    assert log.verify().torn == 1 and log.verify().good
    log.write('home', 'local', 'panel')
    log.write('jog', 'local', 'panel')
    found = log.verify()
    assert found.good and (found.torn, found.last_n) == (1, 8)
    assert rewrite(log, lambda s: [*s[:6], b'another rest\n', *s[7:]])


@settings(max_examples=200)
@given(st.binary(max_size=200))
def test_any_bytes_are_an_entry_or_an_audit_error(line):
    with contextlib.suppress(AuditError):
        parse(line)


@settings(max_examples=120)
@given(st.sampled_from(sorted(Entry.__dataclass_fields__)), VALUES)
def test_any_value_in_an_entry_breaks_the_chain_or_is_the_same(name, value):
    entry = Entry(1, 1.0, 'c', 'w', 'view', 'cli', 'jog', 'ok', prev=FIRST)
    entry = replace(entry, hash=entry.computed())
    row = json.loads(entry.line()) | {name: value}
    found = verify([json.dumps(row).encode()])
    assert row == json.loads(entry.line()) or found.problems or found.torn


def test_no_secret_gets_into_the_log():
    token = shown('0123abcd', SECRET)
    told = hidden({
        'token': token, 'Password': 'x', 'url': 'u', 'note': f'my {token} is', 'at': 'mailtos://a:b@c/d e',
        'axis': 'x', 'step': 0.1, 'nan': float('nan'), 'many': ['x'] * 500,
    })  # fmt: skip
    text = json.dumps(told)
    assert SECRET not in text and 'a:b' not in text and told['axis'] == 'x' and told['step'] == 0.1
    assert len(told['many']) <= 200 and told['Password'] == told['token'] == '(hidden)'
    assert clean(f'wrong token {token}') == 'wrong token (hidden)'


HUGE = (
    st.integers(-(10**4200), 10**4200) | st.integers(10**3990, 10**4000) | st.integers(2**62, 2**65)
)
ODD = st.text(max_size=400) | st.text('\U0001f600\ud800\n"\\', max_size=400)
ANYTHING = VALUES | HUGE | ODD | st.binary(max_size=50) | st.floats()


@settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    st.lists(
        st.tuples(ODD, ODD, ODD, st.dictionaries(ODD | st.integers(), ANYTHING, max_size=40)),
        max_size=4,
    )
)
def test_what_is_written_can_be_read_whatever_was_asked(tmp_path_factory, requests):
    """The writer keeps the promise that the reader relies on: the chain holds after any request."""
    log = AuditLog(tmp_path_factory.mktemp('log'), 'cell')
    for what, who, note, data in requests:
        entry = log.write(what, who, 'panel', data=data, note=note)
        assert parse(entry.line().rstrip('\n').encode()) == entry
        assert len(entry.line()) <= BYTES
    found = log.verify()
    assert found.good and found.entries == len(requests), found.problems
    told = log.last(9)[-1:] if requests else []
    for entry in told:
        data = requests[-1][3]
        assert len(entry.data) >= min(len(data), 1)
        if len(entry.data) < len({str(k)[:40] for k in data}):
            assert entry.data[LEFT_OUT] >= 1


def test_requests_that_were_too_long_for_the_log_are_shortened_with_a_mark(log):
    nines = int('9' * 4000)
    nested: object = 1
    for _ in range(50_000):
        nested = [nested]
    told = log.write(
        'x', 'w', 'panel', data={f'n{i}': nines for i in range(24)} | {'deep': nested}
    ).data
    assert told['n0'].startswith('whole number of 13288 bits') and told[LEFT_OUT] == 1
    told = log.write('x', 'w', 'panel', data={str(i): '\U0001f600' * 5000 for i in range(24)}).data
    assert told['0'].endswith(CUT) and told[LEFT_OUT] >= 1
    assert (
        log.write('x', 'w', 'panel', data={'deep': nested}).data['deep']
        == 'list that cannot be shown'
    )
    assert log.verify().good


def test_a_log_that_an_earlier_version_made_too_long_is_gone_on_with(log):
    """An entry of 100 kB, as the request with numbers of 4000 digits made it."""
    last = log.last(1)[0]
    entry = replace(last, n=last.n + 1, prev=last.hash, data={f'n{i}': 10**3990 for i in range(25)})
    entry = replace(entry, hash=entry.computed())
    with open(log.path, 'a') as f:
        f.write(entry.line())
    log.head.write_text(json.dumps({'n': entry.n, 'hash': entry.hash}))
    log.write('home', 'local', 'panel')
    found = log.verify()
    assert found.good and found.last_n == entry.n + 1, found.problems


def test_searching_a_long_text_for_secrets_takes_no_time():
    """The pattern of an address is quadratic in what it looks at."""
    clean('a.' * 500_000)
    hidden({'x': 'a+.-' * 250_000, 'a.' * 100_000: 1})


@pytest.mark.parametrize('file', ['audit', 'queue', 'tokens'])
def test_a_lock_that_is_held_is_an_error_that_names_file_and_holder(tmp_path, monkeypatch, file):
    """Here the holder is a thread of this process, by another opening of the file."""
    monkeypatch.setattr('waam_node.locks.PATIENCE_S', 0.2)
    log, queue = AuditLog(tmp_path, 'c'), QueueFile(tmp_path)
    tokens = TokenFile(tmp_path / 'tokens.json')
    use = {
        'audit': (log.path, lambda: log.write('x', 'w', 'cli', patience=0.2)),
        'queue': (queue.path, lambda: queue.change(lambda q: q)),
        'tokens': (tokens.path, lambda: tokens.create('x', Role.VIEW)),
    }
    path, change = use[file]
    lock = path.with_name(path.name + '.lock')
    with locked(lock), pytest.raises(OSError, match='held for more than') as e:
        change()
    assert str(lock) in str(e.value) and str(os.getpid()) in str(e.value)
    change()
