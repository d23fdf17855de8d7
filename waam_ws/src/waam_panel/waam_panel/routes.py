"""The one table of routes: method, path, the role that it needs, handler. What stands in no table is not served.

A module with routes has a tuple ROUTES (or a function that makes one); `web.make_app` joins them. Role None: may be
asked for without a session.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Iterable
from contextvars import ContextVar
from dataclasses import dataclass

from aiohttp import web

from waam_shop.roles import Role

from .security import Visitor

Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


@dataclass(frozen=True)
class Route:
    """path: as aiohttp wants it, with {names}."""

    method: str
    path: str
    role: Role | None
    handler: Handler


ROLES: web.AppKey[dict[tuple[str, str], Role | None]] = web.AppKey('roles', dict)
VISITOR = 'visitor'  # key of a request: who asks
WHO: ContextVar[str] = ContextVar('who', default='nobody')  # the same, for what a command does


def add(app: web.Application, routes: Iterable[Route]) -> None:
    """Adds routes with their roles. RuntimeError for one that is there already."""
    roles = app.setdefault(ROLES, {})
    for route in routes:
        added = app.router.add_route(route.method, route.path, route.handler)
        assert added.resource
        roles[route.method, added.resource.canonical] = route.role


def role_of(request: web.Request) -> Role | None:
    """The role that a request needs; a route that is in no table needs one that nobody has. Nothing there: VIEW, so
    that only those who are in learn that there is nothing."""
    if request.match_info.http_exception is not None:
        return Role.VIEW
    resource = request.match_info.route.resource
    path = resource.canonical if resource else ''
    roles = request.app[ROLES]
    if (request.method, path) not in roles:
        raise web.HTTPForbidden(text=f'{request.method} {path} declares no role')
    return roles[request.method, path]


def visitor(request: web.Request) -> Visitor:
    """Who asks; the checks in front of every request have put it there."""
    return request[VISITOR]
