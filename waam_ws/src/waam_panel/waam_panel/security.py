"""Who may ask for what: host, origin, session and anti-forgery checks. No ROS, no web framework.

Local (no token): only requests whose Host is this machine's loopback name and this port (a page of another site that
rebinds its name to 127.0.0.1 has the wrong Host), commands only with the anti-forgery value that our own page carries.
With a token: besides, a session cookie that is handed out for the token. Sessions are signed, not stored, so a page
that is open keeps its rights when the panel starts again.
"""

from __future__ import annotations

import hashlib
import hmac
import ipaddress
import secrets
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urlsplit

SESSION_S = 12 * 3600  # one shift
COOKIE = 'waam_session'
CSRF_HEADER = 'X-Waam-Csrf'
MIN_TOKEN = 16
LOCAL_NAMES = ('127.0.0.1', 'localhost', '[::1]')


class Denied(Exception):
    """A request that is refused; `status` is the HTTP status."""

    def __init__(self, status: int, text: str) -> None:
        super().__init__(text)
        self.status = status


def is_local(bind: str) -> bool:
    """Whether an address to listen on can only be reached from this machine."""
    if bind == 'localhost':
        return True
    try:
        return ipaddress.ip_address(bind).is_loopback
    except ValueError:
        return False


def read_token(file: str, bind: str) -> str:
    """The token, '' for none. Raises ValueError: missing where needed, too short, or readable by others."""
    if not file:
        if not is_local(bind):
            raise ValueError(
                f"parameter 'bind' is {bind}: anything but this machine needs 'token_file' "
                f'(a file with at least {MIN_TOKEN} characters that only you can read)'
            )
        return ''
    path = Path(file)
    try:
        token = path.read_text(encoding='utf-8').strip()
        readable = path.stat().st_mode & 0o077
    except (OSError, UnicodeDecodeError) as e:
        raise ValueError(f"parameter 'token_file': {file}: {e}") from None
    if readable:
        raise ValueError(f"parameter 'token_file': {file} can be read by others (chmod 600)")
    if len(token) < MIN_TOKEN:
        raise ValueError(
            f"parameter 'token_file': {file} holds {len(token)} characters, at least {MIN_TOKEN}"
        )
    return token


def _digest(key: bytes, text: str) -> str:
    return hmac.new(key, text.encode(), hashlib.sha256).hexdigest()


@dataclass(frozen=True)
class Guard:
    """Checks every request. token '' = local use; hosts: names (with port) under which the page may be asked for."""

    token: str
    hosts: frozenset[str]
    key: bytes

    @classmethod
    def create(cls, token: str, bind: str, port: int, more_hosts: tuple[str, ...] = ()) -> Guard:
        """more_hosts: names of this machine for other binds, with or without port."""
        names = {f'{n}:{port}' for n in LOCAL_NAMES}
        more = (n.strip() for n in more_hosts if n.strip())
        names |= {n if n.rpartition(':')[2].isdigit() else f'{n}:{port}' for n in more}
        if not is_local(bind) and bind not in ('0.0.0.0', '::'):
            names.add(f'[{bind}]:{port}' if ':' in bind else f'{bind}:{port}')
        key = hashlib.sha256(b'waam panel' + token.encode()).digest()
        key = key if token else secrets.token_bytes(32)
        return cls(token, frozenset(n.lower() for n in names), key)

    # ---- sessions

    def login(self, token: str) -> str:
        """The value of the session cookie. Raises Denied 401 for a wrong token."""
        if not self.token or not hmac.compare_digest(token.encode(), self.token.encode()):
            raise Denied(401, 'wrong token')
        ends = str(int(time.time()) + SESSION_S)
        return f'{ends}.{_digest(self.key, "session" + ends)}'

    def session_valid(self, cookie: str) -> bool:
        """A signature of ours that has not run out. Without a token everybody on this machine is in."""
        if not self.token:
            return True
        ends, _, signature = cookie.partition('.')
        good = hmac.compare_digest(signature.encode(), _digest(self.key, 'session' + ends).encode())
        return good and ends.isascii() and ends.isdigit() and int(ends) > time.time()

    def csrf(self, cookie: str) -> str:
        """The anti-forgery value of a session; it stands in our page, where no other site can read it."""
        return _digest(self.key, 'csrf' + (cookie if self.token else ''))

    # ---- requests

    def check_host(self, headers: Mapping[str, str]) -> None:
        """Raises Denied 421 for a Host that is not one of ours."""
        host = headers.get('Host', '').lower()
        if host not in self.hosts:
            raise Denied(421, f'this panel is not called {host!r} (parameter allowed_hosts)')

    def same_origin(self, headers: Mapping[str, str]) -> bool:
        """Origin is there and is the page's own."""
        origin = urlsplit(headers.get('Origin', ''))
        return (
            origin.scheme in ('http', 'https')
            and origin.netloc.lower() == headers.get('Host', '').lower()
        )

    def check_read(self, headers: Mapping[str, str], cookie: str) -> None:
        """Pictures, lists, the stream's start. Raises Denied."""
        self.check_host(headers)
        if not self.session_valid(cookie):
            raise Denied(401, 'sign in first')

    def check_stream(self, headers: Mapping[str, str], cookie: str) -> None:
        """WebSocket: browsers allow them across origins, so the origin must be there and be ours."""
        self.check_read(headers, cookie)
        if not self.same_origin(headers):
            raise Denied(403, 'another origin')

    def check_command(self, headers: Mapping[str, str], cookie: str, csrf: str) -> None:
        """Commands: own origin (when the browser says one) and the anti-forgery value. Raises Denied."""
        self._check_sender(headers, cookie)
        if not hmac.compare_digest(csrf.encode(), self.csrf(cookie).encode()):
            raise Denied(403, 'anti-forgery value missing or wrong; load the page again')

    def check_stop(self, headers: Mapping[str, str], cookie: str, csrf: str) -> None:
        """Stop is harmless to forge and deadly to lose: from our own origin it needs no anti-forgery value, so a page
        from before a restart can still stop. Without an origin or from another site it is refused."""
        self._check_sender(headers, cookie)
        if not self.same_origin(headers):
            self.check_command(headers, cookie, csrf)

    def _check_sender(self, headers: Mapping[str, str], cookie: str) -> None:
        self.check_read(headers, cookie)
        if 'Origin' in headers and not self.same_origin(headers):
            raise Denied(403, 'another origin')
        if headers.get('Sec-Fetch-Site', 'same-origin') not in ('same-origin', 'none'):
            raise Denied(403, 'another site')
