"""The verbs of a shop on the command line, and what the panels of the cells tell."""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from waam_shop.cells import CellStatus, check_name, parse
from waam_shop.cli import register
from waam_shop.shop_folder import Places, Shop


@pytest.fixture
def waam(tmp_path, capsys):
    """waam('queue add ...') -> (status, printed)."""
    shop = tmp_path / 'shop'

    def store(cell: str, file: Path) -> str:
        return f'{cell}-{file.name}'

    def check(setup: dict) -> dict:
        if setup.get('mode') == 'nothing':
            raise ValueError("mode: 'nothing' is not one of restore, build")
        return setup

    places = Places(lambda: shop, lambda: 'cell', store, check, lambda f: f.suffix == '.gcode')

    def run(line: str) -> tuple[int, str]:
        parser = argparse.ArgumentParser()
        register(parser.add_subparsers(required=True), places)
        args = parser.parse_args(line.split())
        return args.run_command(args), capsys.readouterr().out

    run.shop = Shop(shop)
    return run


def test_a_queue_is_filled_and_steered_for_each_cell_apart(waam, tmp_path):
    part = tmp_path / 'jaw.stl'
    part.write_bytes(b'solid')
    for name in ('cell2', 'cell2', 'cell3'):
        assert (
            waam(f'queue add {part} --material 316l --layers 2 --job-name x --name {name}')[0] == 0
        )
    waam('queue move 2 1 --name cell2')
    waam('queue release 1 --name cell2')
    rows = json.loads(waam('queue list --json --name cell2')[1])
    assert [(r['id'], r['state']) for r in rows] == [(1, 'released'), (2, 'waiting')]
    assert rows[0]['setup'] == {
        'material': '316l',
        'layers': 2,
        'name': 'x',
        'part': 'cell2-jaw.stl',
    }
    assert len(rows[0]['sha256']) == 64
    with pytest.raises(ValueError, match='item.1 is released'):
        waam('queue release 2 --name cell2')
    waam('queue hold 1 --name cell2')
    waam('queue remove 1 --name cell2')
    assert 'jaw.stl' in waam('queue list --name cell2')[1]
    assert [i.id for i in waam.shop.queue('cell3').read().items] == [1]
    with pytest.raises(ValueError, match='mode'):
        waam(f'queue add {part} --mode nothing')
    assert waam('queue list')[1] == 'the queue of cell is empty\n'


def test_every_verb_of_the_queue_answers_scripts(waam, tmp_path):
    part = tmp_path / 'jaw.stl'
    part.write_bytes(b'solid')
    lines = (f'add {part}', f'add {part}', 'move 2 1', 'release 2', 'hold 2', 'remove 2')
    told = [json.loads(waam(f'queue {line} --json')[1]) for line in lines]
    assert [t['id'] for t in told] == [1, 2, 2, 2, 2, 2]
    assert [t['verb'] for t in told] == [line.split()[0] for line in lines]
    states = [t['item'] and t['item']['state'] for t in told]
    assert states == ['waiting', 'waiting', 'waiting', 'released', 'waiting', None]
    assert told[3]['item']['released_by'].startswith('cli:') and told[3]['panel_up'] is False
    assert [r['id'] for r in json.loads(waam('queue list --json')[1])] == [1]


def test_a_program_goes_into_the_queue_with_its_nominal_part(waam, tmp_path):
    files = [tmp_path / n for n in ('pad.gcode', 'pad.stl')]
    for file in files:
        file.write_bytes(b'x')
    said = waam(f'queue add {files[0]} --dialect slicer --nominal {files[1]} --shift 1,2.5,0')[1]
    assert 'cell-pad.gcode waits' in said
    (row,) = json.loads(waam('queue list --json')[1])
    assert row['setup'] == {
        'dialect': 'slicer',
        'nominal': 'cell-pad.stl',
        'shift_mm': [1.0, 2.5, 0.0],
        'program': 'cell-pad.gcode',
    }


def test_a_token_is_shown_once_and_listed_without_its_secret(waam):
    token = waam('token create tablet --role view --days 1')[1].splitlines()[0]
    listed = waam('token list')[1] + waam('token list --json')[1]
    assert 'tablet' in listed and token not in listed and token.split('_')[2] not in listed
    assert waam('token revoke tablet')[0] == 0
    assert waam('token list')[1].startswith('there are no tokens')


def test_verify_says_by_its_exit_status_whether_the_chain_holds(waam):
    log = waam.shop.audit('cell')
    for n in range(3):
        log.write('jog', 'Ada', 'panel', data={'step': n})
    assert 'step=2' in waam('audit')[1]
    status, said = waam('audit --verify')
    assert status == 0 and '3 entries: unbroken' in said
    kept = said.split()[-1]
    log.path.write_bytes(log.path.read_bytes().replace(b'"step":1', b'"step":9'))
    status, said = waam('audit --verify')
    assert status == 1 and 'entry 2 was changed' in said
    assert waam(f'audit --verify --expect {kept}')[0] == 1


def test_cells_are_up_silent_or_down(waam):
    now = time.time()
    assert 'no cell' in waam('cells')[1]
    waam.shop.tell(CellStatus('cell', now, connected=True, machine='IDLE', queue={'waiting': 2}))
    assert waam('cells')[0] == 0
    waam.shop.tell(CellStatus('cell2', now - 60))
    waam.shop.tell(CellStatus('cell3', now - 60, down=True))
    status, said = waam('cells')
    assert status == 1 and 'silent for 60 s' in said and '2 waiting' in said
    states = {r['name']: r['state'] for r in json.loads(waam('cells --json')[1])}
    assert states == {'cell': 'up', 'cell2': 'silent', 'cell3': 'down'}


def test_notify_without_settings_says_what_to_do_and_init_never_overwrites(waam):
    with pytest.raises(ValueError, match='waam notify init'):
        waam('notify test')
    waam('notify init')
    assert 'shift' in waam('notify list')[1] and 'password' not in waam('notify list')[1]
    with pytest.raises(ValueError, match='there already'):
        waam('notify init')


@pytest.mark.parametrize('name', ['', 'Cell', '2cell', 'a/b', '..', 'a b', 'x' * 40, 'é'])
def test_names_of_cells_are_names_of_folders_and_namespaces(name):
    with pytest.raises(ValueError, match='name of a cell'):
        check_name(name)


@given(st.text(max_size=80), st.dictionaries(st.sampled_from(sorted(CellStatus.__dataclass_fields__)),
       st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5), max_size=8))  # fmt: skip
def test_any_status_can_be_shown(text, values):
    for t in (text, json.dumps(values)):
        row = parse('cell', t).row(1.0)
        assert row['name'] == 'cell' and row['state'] in ('up', 'silent', 'down')
        json.dumps(row, allow_nan=False)
