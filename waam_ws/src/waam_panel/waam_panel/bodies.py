"""Bodies of requests: read after the sender is known, never more than the route allows, never for longer than a while.

Nothing else in the panel reads a body. The limit counts what arrives, whether a length was announced or not.
"""

from __future__ import annotations

import asyncio
import json
from typing import Any
from urllib.parse import parse_qsl

from aiohttp import web

from .security import Denied

FORM, COMMAND = 512, 64 << 10  # bytes: a plain form, a command with JSON
PATIENCE_S = 5.0  # for a form or a command
UPLOAD_S = 120.0
# keys of a request: bytes that its route allows; what was read
LIMIT: web.RequestKey[int] = web.RequestKey('limit', int)
READ: web.RequestKey[bytes] = web.RequestKey('read', bytes)
FORM_TYPE = 'application/x-www-form-urlencoded'


class BadBody(ValueError):
    """A body that is not what the route wants."""


def check_announced(request: web.Request, limit: int) -> None:
    """Before anything is read. Raises Denied: 413 longer than the route allows, 415 packed, 400 an upgrade."""
    request[LIMIT] = limit
    if request.headers.get('Content-Encoding', 'identity').strip().lower() != 'identity':
        raise Denied(415, 'packed bodies are not taken')
    if (request.content_length or 0) > limit:
        raise too_large(limit)


def too_large(limit: int) -> Denied:
    """For a body that is longer than its route allows."""
    return Denied(413, f'the body is longer than the {limit} bytes that are allowed here')


async def read(request: web.Request, limit: int | None = None) -> bytes:
    """The whole body; a second call gives the same. limit: below that of the route. Raises Denied: 413 longer, 408 not
    there in time, 400 cut off."""
    if READ in request:
        return request[READ]
    most = min(request[LIMIT], limit if limit is not None else request[LIMIT])
    pieces, count = [], 0
    try:
        async with asyncio.timeout(PATIENCE_S if most <= COMMAND else UPLOAD_S):
            async for piece in request.content.iter_any():
                pieces.append(piece)
                count += len(piece)
                if count > most:
                    raise too_large(most)
    except TimeoutError:
        raise Denied(408, 'the body did not come in time') from None
    except (web.RequestPayloadError, ConnectionError) as e:
        raise Denied(400, f'the body was cut off ({type(e).__name__})') from None
    request[READ] = b''.join(pieces)
    return b''.join(pieces)


async def form(request: web.Request) -> dict[str, str]:
    """The fields of a small plain form; {} for anything else. Raises Denied."""
    if request.content_type != FORM_TYPE:
        return {}
    text = (await read(request, FORM)).decode('utf-8', 'replace')
    return dict(parse_qsl(text, keep_blank_values=True))


async def json_of(request: web.Request) -> dict[str, Any]:
    """The object in the body. Raises BadBody, Denied."""
    if request.content_type != 'application/json':
        raise BadBody('a small JSON object is wanted')
    try:
        data = json.loads((await read(request, COMMAND)).decode('utf-8'))
    except (ValueError, RecursionError):
        raise BadBody('not JSON') from None
    if not isinstance(data, dict):
        raise BadBody('a JSON object is wanted')
    return data
