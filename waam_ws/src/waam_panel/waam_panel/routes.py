"""The one table of routes: method, path, the role that it needs, the longest body, handler. What stands in no table is
not served.

A module with routes has a tuple ROUTES (or a function that makes one); `web.make_app` joins them. Role None: may be
asked for without a session.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Iterable
from contextvars import ContextVar
from dataclasses import dataclass

from aiohttp import web

from waam_shop.roles import Role

from .bodies import COMMAND
from .security import Visitor

Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


UPLOAD = -1  # longest body: what the panel takes as a file


@dataclass(frozen=True)
class Route:
    """path: as aiohttp wants it, with {names}; body: bytes that a POST may have, or UPLOAD."""

    method: str
    path: str
    role: Role | None
    handler: Handler
    body: int = COMMAND


ROLES: web.AppKey[dict[tuple[str, str], Role | None]] = web.AppKey('roles', dict)
LIMITS: web.AppKey[dict[tuple[str, str], int]] = web.AppKey('limits', dict)
VISITOR: web.RequestKey[Visitor] = web.RequestKey('visitor', Visitor)  # who asks
WHO: ContextVar[str] = ContextVar('who', default='nobody')  # the same, for what a command does


def add(app: web.Application, routes: Iterable[Route]) -> None:
    """Adds routes with their roles. RuntimeError for one that is there already."""
    roles, limits = app.setdefault(ROLES, {}), app.setdefault(LIMITS, {})
    for route in routes:
        added = app.router.add_route(route.method, route.path, route.handler)
        assert added.resource
        place = route.method, added.resource.canonical
        roles[place], limits[place] = route.role, 0 if route.method == 'GET' else route.body


def role_of(request: web.Request) -> Role | None:
    """The role that a request needs; a route that is in no table needs one that nobody has. Nothing there: VIEW, so
    that only those who are in learn that there is nothing."""
    if request.match_info.http_exception is not None:
        return Role.VIEW
    place, roles = _place(request), request.app[ROLES]
    if place not in roles:
        raise web.HTTPForbidden(text=f'{" ".join(place)} declares no role')
    return roles[place]


def limit_of(request: web.Request, upload: int) -> int:
    """Bytes that the body may have; upload: of a file."""
    limit = request.app[LIMITS].get(_place(request), 0)
    return upload if limit == UPLOAD else limit


def _place(request: web.Request) -> tuple[str, str]:
    """Method and path, as they are in the table."""
    if request.match_info.http_exception is not None:
        return request.method, ''
    resource = request.match_info.route.resource
    return request.method, resource.canonical if resource else ''


def visitor(request: web.Request) -> Visitor:
    """Who asks; the checks in front of every request have put it there."""
    return request[VISITOR]
