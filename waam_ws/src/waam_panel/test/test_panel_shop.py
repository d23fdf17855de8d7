"""Roles on every route, the audit log of every command, the queue on the page and what starts from it. No ROS."""

from __future__ import annotations

import asyncio
import http.client
import json
import time

import pytest
from aiohttp.test_utils import TestClient, TestServer
from panel_requests import MACHINE, until

from waam_panel.commanding import SAFE
from waam_panel.programs import ProgramRefused, Programs
from waam_panel.routes import ROLES, Route, add
from waam_panel.shop_link import STOPPED
from waam_panel.web import ALL_ROUTES, make_app
from waam_shop.roles import Role

IDLE = {'id': '', 'state': 'IDLE', 'dir': '', 'error_code': 0, 'message': ''}
SETUP = {'part': 'block.stl', 'as_found': 'block_worn.stl'}


class Visit:
    """One who has signed in at a panel."""

    def __init__(self, panel, token: str = '') -> None:
        self.panel, self.cookie = panel, ''
        if token:
            kind = 'application/x-www-form-urlencoded'
            answer = self.ask('POST', '/api/login', f'token={token}', kind)
            assert answer[0] == 303
            self.cookie = answer[1]['Set-Cookie'].split(';')[0]

    def ask(self, method: str, path: str, body: str = '', kind: str = 'application/json'):
        cookie = self.cookie.partition('=')[2]
        headers = {
            'Origin': self.panel.url, 'Content-Type': kind, 'Cookie': self.cookie,
            'X-Waam-Csrf': self.panel.cell.guard.csrf(cookie),
        }  # fmt: skip
        connection = http.client.HTTPConnection('127.0.0.1', self.panel.server.port, timeout=20)
        connection.request(method, path, body, headers)
        answer = connection.getresponse()
        found = answer.status, dict(answer.getheaders()), answer.read()
        connection.close()
        return found

    def post(self, name: str, **data) -> tuple[int, str]:
        status, _, body = self.ask('POST', f'/api/{name}', json.dumps(data))
        return status, json.loads(body)['message']

    def get(self, path: str):
        return json.loads(self.ask('GET', path)[2])


def path_of(route: Route) -> str:
    return route.path.replace('{name}', 'height').replace('{id}', 'x').replace('{inner}', 'y')


# ---- roles


def test_every_route_of_the_server_declares_its_role(panel):
    app = make_app(panel.cell)
    served = {
        (r.method, r.resource.canonical) for r in app.router.routes() if r.resource is not None
    }
    assert served == set(app[ROLES]) == {(r.method, r.path) for r in ALL_ROUTES}
    open_to_all = {r.path for r in ALL_ROUTES if r.role is None}
    assert open_to_all == {'/login', '/api/login', '/static/panel.css'}
    assert all(r.role and r.role >= Role.OPERATE for r in ALL_ROUTES
               if r.method == 'POST' and r.path not in ('/api/login', '/api/stop'))  # fmt: skip


def test_each_role_may_do_what_it_may_and_nothing_more(make_panel):
    """Walks all routes with every role, and with none."""
    panel = make_panel(tokens=True)
    visits = {role: Visit(panel, panel.tokens[role.label]) for role in Role}
    nobody = Visit(panel)
    for route in ALL_ROUTES:
        if route.role is None or route.path == '/stream':
            continue
        path = path_of(route)
        assert nobody.ask(route.method, path)[0] == (303 if path == '/' else 401), path
        for role, visit in visits.items():
            status, _, body = visit.ask(route.method, path, '{}')
            refused = status == 403 and b'this needs the role' in body
            assert refused == (role < route.role), (path, role, status)
    assert nobody.ask('GET', '/api/nothing')[0] == 401
    assert visits[Role.VIEW].ask('GET', '/api/nothing')[0] == 404


def test_a_route_that_stands_in_no_table_is_refused(panel):
    async def handler(_):
        raise AssertionError('must not run')

    async def ask(path: str) -> int:
        async with TestClient(TestServer(app)) as client:
            headers = {'Host': f'127.0.0.1:{panel.server.port}'}
            async with client.get(path, headers=headers) as answer:
                return answer.status

    app = make_app(panel.cell)
    with pytest.raises(RuntimeError, match='already registered'):
        add(app, (Route('GET', '/stream', Role.VIEW, handler),))
    app.router.add_get('/forgotten', handler)
    assert asyncio.run(ask('/forgotten')) == 403


def test_a_revoked_token_closes_open_pages(make_panel):
    panel = make_panel(tokens=True)
    visit = Visit(panel, panel.tokens['operate'])
    assert visit.post('home')[0] == 200
    panel.cell.shop.shop.tokens().revoke('operate 0')
    assert visit.post('home')[0] == 401 and visit.ask('GET', '/api/me')[0] == 401


# ---- audit log


def test_every_command_is_in_the_log_with_who_and_what_came_of_it(make_panel):
    panel = make_panel(tokens=True)
    visit, log = Visit(panel, panel.tokens['operate']), panel.cell.shop.audit
    visit.post('jog', axis='x', direction=1, step=10)
    panel.operations.refuse = 'no'
    visit.post('home')
    Visit(panel, panel.tokens['view']).post('home')
    visit.post('stop')
    told = [(e.who, e.what, e.outcome) for e in log.last(20)]
    assert told == [
        ('operate 0', 'sign in', 'ok'), ('operate 0', 'jog', 'asked'), ('operate 0', 'home', 'asked'),
        ('operate 0', 'home', 'refused'), ('view 0', 'sign in', 'ok'), ('view 0', '/api/home', 'denied'),
        ('operate 0', 'stop', 'ok'),
    ]  # fmt: skip
    assert log.last(20)[1].data == {'axis': 'x', 'direction': 1, 'step': 10} and log.verify().good


def test_what_the_cell_does_is_in_the_log_whoever_asked_for_it(ready):
    """Another ROS program has started a job: nobody asked for it here."""
    log, shop = ready.cell.shop.audit, ready.cell.shop.shop
    until(lambda: shop.status('cell'), 'first look')
    first = shop.status('cell').utc
    until(lambda: shop.status('cell').utc > first, 'second look: what the first one saw is old')
    for state, armed in (
        ('DEPOSITING', True),
        ('PAUSED', True),
        ('SCANNING', True),
        ('DONE', False),
    ):
        before = len(log.last(20))
        ready.cell.mailbox.put(('machine', MACHINE | {'armed': armed}))
        ready.cell.mailbox.put(('job', IDLE | {'id': 'j1', 'state': state}))
        until(lambda before=before: len(log.last(20)) > before, state)
        time.sleep(0.1)  # both entries of one look
    assert [(e.what, e.data) for e in log.last(20) if 'job' in e.what] == [
        ('job begins', {'job': 'j1'}), ('job pauses', {'job': 'j1'}), ('job goes on', {'job': 'j1'}),
        ('job ends', {'job': 'j1', 'state': 'DONE'}),
    ]  # fmt: skip
    found = {(e.who, e.via, e.outcome) for e in log.last(20)}
    assert found == {('cell', 'cell', 'seen')} and log.verify().good
    assert [e.what for e in log.last(20) if 'arm' in e.what] == ['armed', 'disarmed']


# STOP is logged after it has been carried out; the others change nothing
ASKS = ('/api/stop', '/api/program', '/api/program/layer')


def test_every_route_that_changes_something_writes_the_log(make_panel):
    """Whatever comes of it: a new page cannot forget the log."""
    panel = make_panel(tokens=True)
    visit, log = Visit(panel, panel.tokens['maintain']), panel.cell.shop.audit
    for route in ALL_ROUTES:
        if route.method == 'POST' and route.role and route.path not in ASKS:
            before = log.last(1)[0].n
            visit.ask('POST', path_of(route), '{}')
            new = [e for e in log.last(9) if e.n > before]
            outcome = 'ok' if route.path.removeprefix('/api/') in SAFE else 'asked'
            assert new and new[0].outcome == outcome and new[0].who == 'maintain 0', route.path


def test_a_wrong_token_is_logged_without_the_token(make_panel):
    panel = make_panel(tokens=True)
    wrong = panel.tokens['view'][:-1] + ('a' if panel.tokens['view'][-1] != 'a' else 'b')
    kind = 'application/x-www-form-urlencoded'
    assert Visit(panel).ask('POST', '/api/login', f'token={wrong}', kind)[0] == 401
    (entry,) = [e for e in panel.cell.shop.audit.last(9) if e.outcome == 'denied']
    assert entry.who == 'nobody'
    assert wrong.split('_', 2)[2] not in panel.cell.shop.audit.path.read_text()


# ---- the queue


@pytest.fixture
def ready(panel, write_part):
    """A panel whose cell is ready for a job."""
    write_part(panel.folder / 'parts')
    panel.speak()  # the programs live: what a job said once stays true
    panel.cell.mailbox.put(('machine', MACHINE))
    panel.cell.mailbox.put(('job', IDLE))
    until(lambda: panel.cell.shop.shop.status('cell'), 'first look at the queue')
    return panel


def item(panel, id: int = 1):
    panel.cell.mailbox.put(('machine', MACHINE))  # stays fresh
    return panel.cell.shop.queue.read().item(id)


def test_a_released_item_starts_once_and_follows_its_job(ready):
    visit = Visit(ready)
    assert visit.post('queue_add', **SETUP)[1] == f'item {1} waits'
    assert visit.post('queue_add', **SETUP | {'material': 'lead'})[0] == 409
    time.sleep(0.5)
    assert ready.operations.asked == [] and item(ready).state == 'waiting'
    assert visit.post('queue_release', id=1)[0] == 200
    until(lambda: item(ready) and any(a[0] == 'start' for a in ready.operations.asked), 'start')
    assert [a[0] for a in ready.operations.asked] == ['load', 'start']
    running = {**IDLE, 'id': 'j1', 'state': 'DEPOSITING'}
    ready.cell.mailbox.put(('job', running))
    until(lambda: item(ready).job == 'j1', 'job seen')
    assert (
        visit.post('queue_release', id=1)[0] == 409 and visit.post('queue_remove', id=1)[0] == 409
    )
    ready.cell.mailbox.put(('job', {**running, 'state': 'DONE', 'message': 'good'}))
    until(lambda: item(ready).state == 'done', 'done')
    assert [a[0] for a in ready.operations.asked] == ['load', 'start']
    status = ready.cell.shop.shop.status('cell')
    assert status and status.connected and status.job == 'j1'


def test_stop_while_the_part_is_put_on_the_table_starts_nothing(ready):
    visit = Visit(ready)
    visit.post('queue_add', **SETUP)
    ready.operations.hang.clear()  # loading takes a while
    visit.post('queue_release', id=1)
    until(lambda: item(ready).state == 'running', 'begun')
    time.sleep(0.1)
    assert visit.post('stop')[0] == 200
    ready.operations.hang.set()
    until(lambda: item(ready).state == 'waiting', 'back')
    assert item(ready).note == STOPPED
    assert 'start' not in [a[0] for a in ready.operations.asked]


def test_a_part_that_has_changed_or_a_cell_that_refuses_needs_a_new_release(ready):
    visit = Visit(ready)
    visit.post('queue_add', **SETUP)
    file = ready.folder / 'parts/block.stl'
    whole = file.read_bytes()
    file.write_bytes(b'another part')
    visit.post('queue_release', id=1)
    until(lambda: 'has changed' in item(ready).note, 'changed')
    assert item(ready).state == 'waiting' and ready.operations.asked == []
    visit.post('queue_add', **SETUP)
    visit.post('queue_release', id=2)
    until(lambda: 'block.stl' in item(ready, 2).note, 'no part')
    assert item(ready, 2).state == 'waiting' and ready.operations.asked == []
    file.write_bytes(whole)
    visit.post('queue_add', **SETUP)
    ready.operations.refuse = 'the table is not empty'
    visit.post('queue_release', id=3)
    until(lambda: item(ready, 3).note == 'the table is not empty', 'refused')
    assert item(ready, 3).state == 'waiting'


PROGRAM = 'G21 G90 G94\nM64 P0\nG1 X0 Y0 Z2 F600\nM62 P0\nG1 X40 F600\nM63 P0\n'


def test_a_program_waits_and_starts_like_a_part(ready, monkeypatch):
    looked = []

    async def load(self, choice, machine):
        looked.append(choice)
        if 'G77' in self.files.find(choice.program).read_text():
            raise ProgramRefused('line 5: G77 is not known')

    monkeypatch.setattr(Programs, 'load', load)
    visit = Visit(ready)
    file = ready.folder / 'parts/wall.gcode'
    asked = {'program': 'wall.gcode', 'shift_mm': [5, 0, 0], 'nominal': 'block.stl'}
    assert visit.post('queue_add', **asked)[0] == 409  # there is no such file
    file.write_text(PROGRAM.replace('G1 X40', 'G77 X40'))
    visit.post('queue_add', **asked)
    assert visit.post('queue_add', **asked | {'loop_mode': 'none'})[0] == 409
    time.sleep(0.5)
    assert looked == [] and item(ready).part == 'wall.gcode'
    visit.post('queue_release', id=1)
    until(lambda: 'line 5' in item(ready).note, 'refused by name')
    assert item(ready).state == 'waiting' and ready.operations.asked == []

    file.write_text(PROGRAM)
    visit.post('queue_release', id=1)
    until(lambda: 'has changed' in item(ready).note, 'changed')
    visit.post('queue_add', **asked)
    visit.post('queue_release', id=2)
    until(lambda: item(ready, 2) and len(ready.operations.asked) > 1, 'start')
    assert [a[0] for a in ready.operations.asked] == ['load', 'start_program']
    _, choice, program, nominal, _ = ready.operations.asked[-1]
    assert choice.shift_mm == (5.0, 0.0, 0.0) and program.name == 'wall.gcode'
    assert nominal.name == 'block.stl'


def test_what_makes_no_sense_is_refused_and_changes_nothing(ready):
    visit = Visit(ready)
    visit.post('queue_add', **SETUP)
    before = ready.cell.shop.queue.read()
    for name, data, status in (
        ('queue_add', {'program': '../wall.gcode'}, 409), ('queue_add', {'program': 'block.stl'}, 409),
        ('queue_move', {'id': 1, 'place': 0}, 409), ('queue_move', {'id': 1}, 400), ('queue_hold', {'id': True}, 400),
        ('queue_release', {'id': 9}, 409), ('queue_remove', {'id': '1'}, 400), ('queue_add', {'part': '../x.stl'}, 409),
        ('queue_add', {'part': "x'; DROP TABLE jobs; --.stl"}, 409), ('queue_hold', {'id': 1}, 409),
    ):  # fmt: skip
        assert visit.post(name, **data)[0] == status, (name, data)
        assert ready.cell.shop.queue.read() == before, (name, data)


def test_the_page_of_cells_shows_all_of_the_shop(make_panel, write_part):
    first, second = make_panel(name='cell'), make_panel(name='cell2')
    write_part(first.folder / 'parts')
    Visit(second).post('queue_add', **SETUP)
    until(lambda: len(Visit(first).get('/api/cells')['cells']) == 2, 'both cells')
    until(lambda: Visit(first).get('/api/cells')['cells'][1]['queue'] == {'waiting': 1}, 'queue')
    found = Visit(first).get('/api/cells')
    assert found['here'] == 'cell' and found['queue']['count'] == 0
    assert [(c['name'], c['state']) for c in found['cells']] == [('cell', 'up'), ('cell2', 'up')]
    second.server.close()
    assert Visit(first).get('/api/cells')['cells'][1]['state'] == 'down'
