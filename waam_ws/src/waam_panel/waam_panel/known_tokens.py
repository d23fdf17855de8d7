"""The tokens as they were a moment ago: what the disk does holds up nobody who asks. No ROS."""

from __future__ import annotations

import threading
import time

from waam_shop.token_file import TokenFile
from waam_shop.tokens import TokenBook, TokenError

AGAIN_S = 0.5  # between two looks at the file


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
