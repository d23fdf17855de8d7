"""Tokens: who may come in, with which role. Only hashes are kept. Pure: secrets and times are arguments.

A token is `waam_<id>_<secret>`. The secret is 32 random bytes (43 letters), never chosen by a person, so one SHA-256
of it is enough: there is nothing to guess that a slow hash would slow down. The id finds the entry; the secret is
compared in constant time, against a dummy when there is no such id.
"""

from __future__ import annotations

import hashlib
import hmac
import json
import re
from dataclasses import asdict, dataclass
from typing import Any

from waam_process.rows import RowError, row_of
from waam_process.safe_files import FileError, parse_json

from .roles import ROLES, Role, role_of

PREFIX = 'waam'
ID = re.compile(r'[0-9a-f]{8}')
NAME = re.compile(r'[A-Za-z0-9][A-Za-z0-9 ._@-]{0,39}')
HASH = re.compile(r'[0-9a-f]{64}')
VERSION = 1


class TokenError(ValueError):
    """The file of tokens, or what is asked of it, is wrong; the text says where and what."""


@dataclass(frozen=True)
class Token:
    """id: public; sha256: hex digest of the secret; created, expires: UTC in s, 0 = never."""

    id: str
    name: str
    role: str
    sha256: str
    created: float
    expires: float = 0.0

    def valid(self, now: float) -> bool:
        """It has not run out."""
        return not self.expires or now < self.expires

    @property
    def rights(self) -> Role:
        """The role as a value that can be compared."""
        return role_of(self.role)


def digest(secret: str) -> str:
    """What is stored of a secret."""
    return hashlib.sha256(secret.encode()).hexdigest()


@dataclass(frozen=True)
class TokenBook:
    """All tokens of a shop."""

    tokens: tuple[Token, ...] = ()

    @classmethod
    def parse(cls, text: str) -> TokenBook:
        """From the text of the file. Raises TokenError; never anything else, whatever the text is."""
        try:
            data = parse_json(text, 'tokens')
        except FileError:
            hint = ' (a token itself? only hashes are kept: waam token create)'
            raise TokenError(f'not a file of tokens{hint}') from None
        if not isinstance(data, dict) or data.get('version') != VERSION:
            raise TokenError(f'not a file of tokens of version {VERSION} (waam token create)')
        rows = data.get('tokens')
        if not isinstance(rows, list):
            raise TokenError('tokens: a list is wanted')
        tokens = tuple(_token(number, row) for number, row in enumerate(rows, 1))
        if len({t.id for t in tokens}) != len(tokens):
            raise TokenError('two tokens have the same id')
        return cls(tokens)

    def text(self) -> str:
        """For the file."""
        rows = [asdict(t) for t in self.tokens]
        return json.dumps({'version': VERSION, 'tokens': rows}, indent=1) + '\n'

    def add(self, token: Token, now: float) -> TokenBook:
        """Raises TokenError for a bad name, or one that a valid token has already."""
        _check(token, f'token {token.name!r}')
        if any(t.name == token.name and t.valid(now) for t in self.tokens):
            raise TokenError(f'there is a token {token.name!r} already (waam token revoke)')
        return TokenBook((*self.tokens, token))

    def revoke(self, which: str) -> tuple[TokenBook, Token]:
        """By id or name. Raises TokenError when there is none."""
        found = [t for t in self.tokens if which in (t.id, t.name)]
        if not found:
            raise TokenError(f'there is no token {which!r} (waam token list)')
        gone = found[-1]
        return TokenBook(tuple(t for t in self.tokens if t is not gone)), gone

    def find(self, id: str, now: float) -> Token | None:
        """A token that may still be used."""
        return next((t for t in self.tokens if t.id == id and t.valid(now)), None)

    def check(self, given: str, now: float) -> Token | None:
        """The token that a person has typed, None for a wrong one. Takes as long for an id that does not exist."""
        _, _, rest = given.strip().partition('_')
        id, _, secret = rest.partition('_')
        token = self.find(id, now)
        wanted = token.sha256 if token else digest('')
        same = hmac.compare_digest(digest(secret), wanted)
        return token if token and same and given.strip() == shown(id, secret) else None


def shown(id: str, secret: str) -> str:
    """The token as its owner gets it, once."""
    return f'{PREFIX}_{id}_{secret}'


def _token(number: int, row: Any) -> Token:
    where = f'token {number} of the file'
    try:
        token = row_of(Token, row)
    except RowError as e:
        raise TokenError(f'{where}: {e}') from None
    _check(token, where)
    return token


def _check(token: Token, where: str) -> None:
    for name, pattern in (('id', ID), ('name', NAME), ('sha256', HASH)):
        if not pattern.fullmatch(value := getattr(token, name)):
            raise TokenError(f'{where}: {name}: {value[:40]!r} is not allowed')
    if token.role not in ROLES:
        raise TokenError(f'{where}: role {token.role[:40]!r}, must be one of {", ".join(ROLES)}')
    if min(token.created, token.expires) < 0:
        raise TokenError(f'{where}: created or expires is not a time')
