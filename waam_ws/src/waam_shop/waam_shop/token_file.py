"""The file of tokens, the key that signs sessions beside it, and new tokens. Only its owner can read either."""

from __future__ import annotations

import os
import secrets
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from waam_node.locks import locked

from .durable import write_durably
from .roles import Role
from .tokens import Token, TokenBook, TokenError, digest, shown

KEY_BYTES = 32


class TokenFile:
    """Read again when it has changed, so that a token that is revoked is out at once."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._stamp: tuple[int, int, int] | None = None
        self._book = TokenBook()

    def book(self) -> TokenBook:
        """Raises TokenError: damaged, or readable by others. A file that is missing holds no token."""
        try:
            status = self.path.stat()
        except FileNotFoundError:
            self._stamp, self._book = None, TokenBook()
            return self._book
        except OSError as e:
            raise TokenError(f'{self.path}: {e.strerror}') from None
        if status.st_mode & 0o077:
            raise TokenError(f'{self.path} can be read by others (chmod 600)')
        stamp = (status.st_mtime_ns, status.st_size, status.st_ino)
        if stamp != self._stamp:
            self._book, self._stamp = self._read(), stamp
        return self._book

    def _read(self) -> TokenBook:
        try:
            return TokenBook.parse(self.path.read_text(encoding='utf-8'))
        except (OSError, UnicodeDecodeError, TokenError) as e:
            raise TokenError(f'{self.path}: {e}') from None

    def create(self, name: str, role: Role, days: float = 0.0) -> str:
        """A new token, shown this once. days: until it runs out, 0 = never. Raises TokenError."""
        id, secret, now = secrets.token_hex(4), secrets.token_urlsafe(32), time.time()
        expires = now + days * 86400 if days else 0.0
        token = Token(id, name, role.label, digest(secret), now, expires)
        self._change(lambda book: book.add(token, now))
        return shown(id, secret)

    def revoke(self, which: str) -> Token:
        """By id or name. Raises TokenError."""
        gone: list[Token] = []

        def change(book: TokenBook) -> TokenBook:
            left, token = book.revoke(which)
            gone.append(token)
            return left

        self._change(change)
        return gone[0]

    def _change(self, change: Callable[[TokenBook], TokenBook]) -> None:
        with locked(self.path.with_name(self.path.name + '.lock')):
            self._stamp = None
            write_durably(self.path, change(self.book()).text(), 0o600)

    def key(self) -> bytes:
        """Signs sessions, so that a page that is open keeps its rights when a panel starts again; made when missing."""
        file = self.path.with_name(self.path.name + '.key')
        if not file.exists():
            self._make_key(file)
        key = file.read_bytes()
        if len(key) != KEY_BYTES or file.stat().st_mode & 0o077:
            raise TokenError(
                f'{file}: damaged or readable by others; remove it (all sign in again)'
            )
        return key

    @staticmethod
    def _make_key(file: Path) -> None:
        """Whole or not at all: panel and stop lane may make it at the same time, and both must have the same one."""
        file.parent.mkdir(parents=True, exist_ok=True)
        made = file.with_name(f'{file.name}.{os.getpid()}')
        descriptor = os.open(made, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
        with open(descriptor, 'wb') as f:
            f.write(secrets.token_bytes(KEY_BYTES))
        with suppress(FileExistsError):
            os.link(made, file)
        made.unlink()
