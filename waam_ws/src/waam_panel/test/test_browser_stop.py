"""The page's STOP in a real browser: by its second way while the panel does not answer, and on both ways. No ROS."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import threading
import time

import pytest
from panel_client import FakeBridge

from waam_node.stop_socket import STOP

CHROMIUM = shutil.which('chromium') or shutil.which('google-chrome')
pytest.importorskip('playwright', reason='playwright is not installed (pip install playwright)')
pytestmark = pytest.mark.skipif(not CHROMIUM, reason='chromium is not installed (apt-get)')


@pytest.fixture
def lane(make_panel, tmp_path):
    """lane(tokens) -> panel, bridge: a panel whose page knows a second way, and what comes out of that."""
    made = []

    def make(tokens: bool):
        panel, bridge = make_panel(tokens=tokens), FakeBridge(tmp_path / 'stop')
        words = ['--socket', tmp_path / 'stop', '--port', 0, '--page-port', panel.server.port]
        words += ['--token-file', tmp_path / 'shop' / 'tokens.json'] if tokens else []
        process = subprocess.Popen(
            [sys.executable, '-m', 'waam_panel.stop_lane', *map(str, words)],
            stdout=subprocess.PIPE,
            text=True,
        )
        panel.cell.stop_port = int(process.stdout.readline().rsplit(' ', 1)[1])
        made.append((process, bridge))
        return panel, bridge

    yield make
    for process, bridge in made:
        process.terminate()
        process.wait(20)
        process.stdout.close()
        bridge.close()


@pytest.mark.parametrize('tokens', [False, True], ids=['local', 'tokens'])
@pytest.mark.parametrize('path', ['/', '/cells'])
def test_stop_gets_through_while_the_panel_does_not_answer(
    lane, browser, monkeypatch, tokens, path
):
    from playwright.sync_api import expect

    panel, bridge = lane(tokens)
    hangs = threading.Event()

    def stop() -> str:
        hangs.wait(60)
        panel.operations.asked.append(('stop',))
        return 'stopped'

    monkeypatch.setattr(panel.operations, 'stop', stop)
    page, said = browser.new_page(), []
    page.on('pageerror', lambda e: said.append(str(e)))
    page.on('console', lambda m: said.append(m.text) if m.type == 'error' else None)
    page.goto(panel.url)
    if tokens:
        page.fill('[name=token]', panel.tokens['view'])
        page.click('button')
        page.wait_for_url(f'{panel.url}/')
    page.goto(panel.url + path)
    said.clear()  # the page of the token asks for an icon, too
    try:
        page.click('#stop')
        expect(page.locator('#toast')).to_contain_text(re.compile('stopped'), timeout=20_000)
        assert bridge.got == [STOP] and panel.operations.asked == []
    finally:
        hangs.set()
    end = time.monotonic() + 20
    while panel.operations.asked != [('stop',)]:
        assert time.monotonic() < end, 'the panel was asked as well'
        time.sleep(0.02)
    assert said == []
    page.close()
