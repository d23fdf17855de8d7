"""Who may ask for what: host, origin, session, role and anti-forgery checks. No ROS, no web framework.

Local (no tokens): only requests whose Host is this machine's loopback name and this port (a page of another site that
rebinds its name to 127.0.0.1 has the wrong Host), commands only with the anti-forgery value that our own page carries.
With tokens: besides, a session cookie that is handed out for one of them. Sessions are signed, not stored, so a page
that is open keeps its rights when the panel starts again; the token behind one is looked up with every request, so a
token that is revoked is out within a second (`KnownTokens`).
"""

from __future__ import annotations

import hashlib
import hmac
import ipaddress
import re
import secrets
import ssl
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urlsplit

from waam_shop.roles import Role
from waam_shop.token_file import TokenFile
from waam_shop.tokens import TokenBook, TokenError

SESSION_S = 12 * 3600  # one shift
COOKIE = 'waam_session'
CSRF_HEADER = 'X-Waam-Csrf'
LOCAL = 'local'  # who asks without a token, on this machine
_COOKIE = re.compile(r'([0-9a-f]{8})\.([0-9]{1,12})\.([0-9a-f]{64})')
# what a page may do that was written elsewhere, such as a report: show itself
REPORT_POLICY = (
    "default-src 'none'; style-src 'unsafe-inline'; img-src data:; "
    'sandbox allow-popups allow-same-origin'
)
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


@dataclass(frozen=True)
class Visitor:
    """who: name of the token, or LOCAL."""

    who: str
    role: Role


AGAIN_S = 0.5  # between two looks at the file of tokens


class KnownTokens:
    """Looks at the file in a thread of its own. TokenError at first, when it cannot be read. Later such a file leaves
    the tokens as they were: who could stop the cell can still stop it."""

    def __init__(self, file: TokenFile) -> None:
        self._file = file
        self._book: TokenBook = file.book()
        self._key = file.key()
        threading.Thread(target=self._follow, name='tokens', daemon=True).start()

    def book(self) -> TokenBook:
        """See `TokenFile.book`; never waits."""
        return self._book

    def key(self) -> bytes:
        """See `TokenFile.key`."""
        return self._key

    def _follow(self) -> None:
        while True:
            time.sleep(AGAIN_S)
            try:
                self._book = self._file.book()
            except TokenError:
                continue


def open_tokens(file: str, bind: str, tls: bool) -> TokenFile | None:
    """The tokens that let people in; None: local use without any. Raises ValueError: missing where they are needed
    (any address but this machine's needs tokens and TLS), damaged, or readable by others."""
    away = f"parameter 'bind' is {bind}: anything but this machine needs"
    if not is_local(bind) and not file:
        raise ValueError(f"{away} 'token_file' (waam token create) and 'tls_cert' with 'tls_key'")
    if not is_local(bind) and not tls:
        raise ValueError(
            f"{away} 'tls_cert' and 'tls_key': without TLS tokens can be read on the network"
        )
    if not file:
        return None
    tokens = TokenFile(Path(file))
    if not tokens.path.exists():
        raise ValueError(f"parameter 'token_file': {file}: No such file (waam token create)")
    try:
        if not tokens.book().tokens:
            raise TokenError(f'{file} holds no token (waam token create)')
    except TokenError as e:
        raise ValueError(f"parameter 'token_file': {e}") from None
    return tokens


def tls_context(cert: str, key: str) -> ssl.SSLContext | None:
    """TLS 1.2 or newer from a certificate (with its chain) and its key; None without. Raises ValueError."""
    if not cert and not key:
        return None
    if not cert or not key:
        raise ValueError("parameters 'tls_cert' and 'tls_key' belong together")
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    for name, file in (('tls_cert', cert), ('tls_key', key)):
        if not Path(file).is_file():
            raise ValueError(f"parameter '{name}': {file}: no such file")
    if Path(key).stat().st_mode & 0o077:
        raise ValueError(f"parameter 'tls_key': {key} can be read by others (chmod 600)")
    try:
        # a key with a passphrase would wait for one at a terminal that nobody sees
        context.load_cert_chain(cert, key, password=lambda: '')
    except (ssl.SSLError, OSError) as e:
        raise ValueError(f"parameters 'tls_cert', 'tls_key': {cert}, {key}: {e}") from None
    return context


def _digest(key: bytes, text: str) -> str:
    return hmac.new(key, text.encode(), hashlib.sha256).hexdigest()


@dataclass(frozen=True)
class Guard:
    """Checks every request. tokens None = local use; hosts: names (with port) under which the page may be asked for;
    key: signs sessions."""

    tokens: KnownTokens | TokenFile | None
    hosts: frozenset[str]
    key: bytes

    @classmethod
    def create(
        cls,
        tokens: KnownTokens | TokenFile | None,
        bind: str,
        port: int,
        more_hosts: tuple[str, ...] = (),
    ) -> Guard:
        """more_hosts: names of this machine for other binds, with or without port."""
        names = {f'{n}:{port}' for n in LOCAL_NAMES}
        more = (n.strip() for n in more_hosts if n.strip())
        names |= {n if n.rpartition(':')[2].isdigit() else f'{n}:{port}' for n in more}
        if not is_local(bind) and bind not in ('0.0.0.0', '::'):
            names.add(f'[{bind}]:{port}' if ':' in bind else f'{bind}:{port}')
        key = tokens.key() if tokens else secrets.token_bytes(32)
        return cls(tokens, frozenset(n.lower() for n in names), key)

    # ---- sessions

    def login(self, token: str) -> tuple[str, Visitor]:
        """The value of the session cookie, and whose it is. Raises Denied 401 for a wrong token."""
        now = time.time()
        found = self._book().check(token, now) if self.tokens else None
        if found is None:
            raise Denied(401, 'wrong token')
        ends = f'{found.id}.{int(now) + SESSION_S}'
        return f'{ends}.{_digest(self.key, "session" + ends)}', Visitor(found.name, found.rights)

    def visitor(self, cookie: str) -> Visitor | None:
        """Whose session it is: a signature of ours that has not run out, of a token that is still good. None: nobody's.
        Without tokens everybody on this machine is in, with every right. Raises Denied 503: the tokens are damaged."""
        if not self.tokens:
            return Visitor(LOCAL, Role.MAINTAIN)
        parts = _COOKIE.fullmatch(cookie)
        if not parts:
            return None
        id, ends, signature = parts.groups()
        now = time.time()
        if not hmac.compare_digest(signature, _digest(self.key, f'session{id}.{ends}')):
            return None
        token = self._book().find(id, now) if int(ends) > now else None
        return Visitor(token.name, token.rights) if token else None

    def _book(self) -> TokenBook:
        assert self.tokens
        try:
            return self.tokens.book()
        except TokenError:
            raise Denied(503, 'the file of tokens cannot be read (see waam token list)') from None

    def csrf(self, cookie: str) -> str:
        """The anti-forgery value of a session; it stands in our page, where no other site can read it."""
        return _digest(self.key, 'csrf' + (cookie if self.tokens else ''))

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

    def check_read(
        self, headers: Mapping[str, str], cookie: str, role: Role = Role.VIEW
    ) -> Visitor:
        """Pictures, lists, the stream's start. Returns who asks. Raises Denied: 401 not signed in, 403 another role."""
        self.check_host(headers)
        visitor = self.visitor(cookie)
        if visitor is None:
            raise Denied(401, 'sign in first')
        if visitor.role < role:
            raise Denied(403, f'this needs the role {role.label}; yours is {visitor.role.label}')
        return visitor

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
        self.check_origin(headers)

    def check_site(self, headers: Mapping[str, str]) -> None:
        """What a browser fetches for a page of another site; links that somebody follows are let through. Raises
        Denied."""
        site, mode = headers.get('Sec-Fetch-Site', ''), headers.get('Sec-Fetch-Mode', 'navigate')
        if site == 'cross-site' and mode != 'navigate':
            raise Denied(403, 'another site')

    def check_origin(self, headers: Mapping[str, str]) -> None:
        """A browser that says that a page of another site asks. Raises Denied."""
        if 'Origin' in headers and not self.same_origin(headers):
            raise Denied(403, 'another origin')
        if headers.get('Sec-Fetch-Site', 'same-origin') not in ('same-origin', 'none'):
            raise Denied(403, 'another site')
