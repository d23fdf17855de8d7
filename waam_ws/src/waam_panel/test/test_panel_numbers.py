"""Numbers as people type them: read wholly or refused, on the server; so does the browser (test_browser_entry)."""

from __future__ import annotations

import json
import math
from decimal import Decimal

import pytest
from hypothesis import given
from hypothesis import strategies as st
from panel_requests import ask, machine_says

from waam_panel import numbers
from waam_panel.numbers import NumberRefused
from waam_panel.programs import ProgramRefused, parse_choice
from waam_panel.setup_form import LIMITS, FormError, JobSetup, parse

MATERIALS = ('er70s-6', '316l')
READ = {
    '0.2': 0.2, '0,2': 0.2, ' 0,2 mm': 0.2, '\u00a00.2\u202fmm ': 0.2, '0,200': 0.2, '+1.5': 1.5, '.5': 0.5,
    ',5': 0.5, '-0,25': -0.25, '\u22121': -1.0, '3': 3.0, '007': 7.0, '2mm': 2.0, '1,250': 1.25, '0.2500': 0.25,
}  # fmt: skip
REFUSED = (
    '', '  ', '1,234.5', '1.234,5', '1 000', '1\u00a0000', '1e', '1e3', '1E-3', 'e5', 'NaN', 'nan', 'inf',
    'Infinity', '0x10', '0b1', '1_000', '\uff10.\uff12', '\u0660\u066b\u0662', '\u0968', '\u00bd', '1/2', '0.2.1',
    '1,,2', '5.', '5,', '.', ',', '-', '+', '--1', '1-', '- 1', '0.2 in', '0.2 cm', '0.2 MM', 'mm', '0.2 mm mm', '2 3',
    '\u200b1', '\ufeff1', '1\n', "1'000", '(1)', '1%', '~1', '=1+1', '1;2', '9' * 60,
)  # fmt: skip


@pytest.mark.parametrize('text', READ, ids=ascii)
def test_both_writings_are_the_same_number(text):
    assert numbers.read(text, -5.0, 9.0, 'mm') == READ[text]


@pytest.mark.parametrize('text', REFUSED, ids=ascii)
def test_what_is_not_one_number_is_refused_by_name(text):
    with pytest.raises(NumberRefused) as e:
        numbers.read(text, -1000.0, 1000.0, 'mm')
    assert len(str(e.value)) < 160 and (
        not text.strip() or text[:3].strip('\n') in str(e.value) or ascii(text)[1:4]
    )


def test_a_mark_that_may_stand_for_thousands_is_asked_about():
    for text in ('1,000', '1.000', '-1,000'):
        with pytest.raises(NumberRefused, match='can be read as -?1 or as -?1000'):
            numbers.read(text, -1000, 1000)
    assert numbers.read('1,000', 0, 999) == 1.0 and numbers.read('0,500', -1000, 1000) == 0.5


@given(
    st.decimals(-999, 999, places=4),
    st.sampled_from('.,'),
    st.sampled_from(('', ' ', 'mm', ' mm', '\t')),
)
def test_every_number_is_read_as_it_is_written(value, mark, tail):
    text = format(value, 'f').replace('.', mark)
    assert numbers.read(text + tail, -999, 999, 'mm') == float(value)


@given(st.text('0123456789.,+-eE \u00a0\u0661xmnaNf', max_size=9), st.sampled_from(('', 'mm')))
def test_a_text_is_refused_or_worth_its_digits(text, unit):
    try:
        value = numbers.read(text, -1e6, 1e6, unit)
    except NumberRefused:
        return
    plain = text.strip(numbers.BLANKS).removesuffix(unit).strip(numbers.BLANKS).replace(',', '.')
    assert value == float(Decimal(plain)) and plain.count('.') <= 1 and plain.isascii()


@pytest.mark.parametrize(
    'value',
    (True, None, [], {}, math.nan, math.inf, 10**400, -(10**4200), '1e5', b'1', 1 + 2j),
    ids=repr,
)
def test_a_value_of_json_is_a_number_within_its_limits_or_refused(value):
    with pytest.raises(NumberRefused) as e:
        numbers.of(value, 0, 9)
    assert len(str(e.value)) < 160


@pytest.mark.parametrize('name', LIMITS)
def test_every_number_of_a_setup_is_read_in_both_writings_and_an_empty_one_is_not_zero(name):
    low, high = LIMITS[name]
    default = getattr(JobSetup(), name)
    given_number = 3 if isinstance(default, int) else round(low + 0.37 * (high - low), 2)
    dotted = str(given_number)
    for text in (dotted, dotted.replace('.', ','), f' {dotted} ', given_number):
        setup = parse({'part': 'a.stl', 'mode': 'restore', name: text}, MATERIALS)
        assert getattr(setup, name) == given_number
    assert str(getattr(parse({'part': 'a.stl', name: None}, MATERIALS), name)) == str(default)
    for text in (
        '',
        ' ',
        f'{high * 10 + 11}',
        f'{low - 1:g}',
        '1,234.5',
        'NaN',
        '1e',
        math.nan,
        10**400,
        True,
    ):
        with pytest.raises(FormError, match=f'^{name}: '):
            parse({'part': 'a.stl', name: text}, MATERIALS)


def test_a_shift_of_a_program_is_read_alike():
    def shift(*mm):
        return parse_choice({'program': 'p.gcode', 'shift_mm': mm}, MATERIALS).shift_mm

    assert shift('0,2', '-1.5', None) == (0.2, -1.5, 0.0)
    for wrong in ('', '1 000', '1,000', 1001, math.nan, 10**400, True):
        with pytest.raises(ProgramRefused, match='^shift_mm: '):
            shift(wrong, 0, 0)


def test_the_setup_is_read_back_in_words():
    setup = parse(
        {'part': 'jaw.stl', 'layers': '3', 'tolerance_mm': '0,2', 'layer_height_mm': '2,0'},
        MATERIALS,
    )
    assert setup.words == (
        'restore jaw.stl; er70s-6, closed loop; tolerance 0.2 mm; 3 layers; layer height 2 mm; '
        'bead width as the material says; 1 pass; finish as-laid; allowance 0 mm'
    )
    machined = {'part': 'jaw.stl', 'finish': 'machined'}
    assert parse(machined, MATERIALS).words.endswith(
        'finish machined; allowance chosen by the forecast'
    )
    assert parse(machined | {'allowance_mm': 0.5}, MATERIALS).words.endswith('allowance 0.5 mm')
    with pytest.raises(FormError, match='finish, allowance_mm: only to restore'):
        parse(machined | {'mode': 'build'}, MATERIALS)


def test_requests_of_the_page_are_read_alike_and_say_what_was_understood(panel):
    (panel.folder / 'parts').mkdir(exist_ok=True)
    (panel.folder / 'parts' / 'a.stl').write_bytes(b'solid')
    machine_says(panel)
    status, answer = ask(
        panel, 'load', {'part': 'a.stl', 'tolerance_mm': '0,2', 'allowance_mm': '0,5 mm'}
    )
    assert (
        status == 200
        and 'tolerance 0.2 mm' in answer['message']
        and 'allowance 0.5 mm' in answer['message']
    )
    assert 'tolerance 0.2 mm' in panel.cell.state.sections['setup']['words']
    assert ask(panel, 'jog_wire', {'mm': '-2,5'})[0] == 200
    assert panel.operations.asked[-1] == ('jog_wire', -2.5e-3)
    assert ask(panel, 'override', {'speed': '0,9'})[0] == 200
    assert panel.operations.asked[-1][:2] == ('override', 0.9)
    before = len(panel.operations.asked)
    for name, data in (
        ('jog_wire', {'mm': ''}), ('jog_wire', {'mm': '1 0'}), ('gain', {'value': '0,2,1'}),
        ('override', {'wire': 'NaN'}),
        ('load', {'part': 'a.stl', 'tolerance_mm': ''}), ('load', {'part': 'a.stl', 'layers': '1,000'}),
    ):  # fmt: skip
        status, answer = ask(panel, name, data)
        assert status in (400, 409) and next(k for k in data if k != 'part') in answer['message'], (
            answer
        )
    assert ask(panel, 'jog_wire', json.dumps({'mm': 10**4000}).encode())[0] == 400
    assert len(panel.operations.asked) == before


def test_a_jog_is_one_of_those_that_the_page_has(panel):
    good = {'axis': 'x', 'direction': 1, 'step': 1.0, 'held': False}
    machine_says(panel)
    for wrong in (
        {'step': True},
        {'direction': True},
        {'held': 'false'},
        {'step': '1'},
        {'step': 2},
        {'axis': ['x']},
    ):
        assert ask(panel, 'jog', good | wrong)[0] == 400, wrong
    assert not panel.operations.asked and ask(panel, 'jog', good)[0] == 200
