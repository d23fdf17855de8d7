import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from waam_process import materials
from waam_process.materials import MaterialError, parse_quantity


@pytest.fixture
def own_table(tmp_path):
    """Writes an operator's file: the packaged steel with changes; None removes a field."""

    def write(name='my-steel', **changes):
        entry = yaml.safe_load(materials.TABLE.read_text())['er70s-6'] | changes
        entry = {k: v for k, v in entry.items() if v is not None}
        path = tmp_path / 'own.yaml'
        path.write_text(yaml.safe_dump({name: entry}))
        return path

    return write


def test_the_packaged_table_is_complete():
    table = materials.load()
    assert {'er70s-6', 'er4043', '316l'} <= set(table)
    assert materials.DEFAULT in table
    for material in table.values():
        assert material.feed_min <= material.wire_feed <= material.feed_max


def test_figures_of_the_default_wire():
    steel = materials.get('ER70S-6')
    assert steel.wire_diameter == pytest.approx(1.2e-3)
    assert steel.wire_area == pytest.approx(1.131e-6, rel=1e-3)
    assert steel.speed == pytest.approx(0.01)
    assert steel.feed_max == pytest.approx(0.2)
    assert steel.interpass_limit == 250
    assert 5e-6 < steel.diffusivity < 15e-6


def test_unknown_material_names_the_known_ones():
    with pytest.raises(MaterialError) as e:
        materials.get('er70s6')
    for word in ("'er70s6'", "did you mean 'er70s-6'?", 'er4043', '316l'):
        assert word in str(e.value)


def test_own_file_adds_and_replaces(own_table):
    path = own_table('my-steel', density='7.80 g/cm3')
    table = materials.load(path)
    assert table['my-steel'].density == pytest.approx(7800)
    assert 'er70s-6' in table
    assert materials.get('My-Steel', path).name == 'my-steel'
    assert (
        materials.get('er70s-6', own_table('er70s-6', interpass_limit='165 degC')).interpass_limit
        == 165
    )
    assert materials.get('er70s-6').interpass_limit == 250


@pytest.mark.parametrize(
    ('changes', 'words'),
    [
        ({'wire_diameter': 1.2}, ('wire_diameter', "'1.2' is not a length", 'mm')),
        ({'wire_diameter': '1.2 V'}, ('wire_diameter', 'unit')),
        ({'wire_diameter': '1.2 m'}, ('wire_diameter', 'outside')),
        ({'speed': 'ten mm/s'}, ('speed', 'number')),
        ({'speed': '.nan mm/s'}, ('speed', 'number')),
        ({'speed': 'nan mm/s'}, ('speed', 'outside')),
        ({'efficiency': 1.5}, ('efficiency', 'outside')),
        ({'density': None}, ('density', 'missing')),
        ({'desnity': '1 kg/m3'}, ("'desnity'", "did you mean 'density'")),
        ({'speed_min': '15 mm/s'}, ('speed_min', 'in order')),
        ({'feed_max': '4 m/min'}, ('wire_feed', 'in order')),
    ],
)
def test_a_bad_entry_is_refused_naming_file_material_and_field(own_table, changes, words):
    path = own_table(**changes)
    with pytest.raises(MaterialError) as e:
        materials.load(path)
    for word in (str(path), "'my-steel'", *words):
        assert word in str(e.value)


@pytest.mark.parametrize('text', ['', '- a\n- b', 'a: [', 'a: 3', '\x00'])
def test_a_file_that_is_no_table(tmp_path, text):
    path = tmp_path / 'bad.yaml'
    path.write_text(text)
    with pytest.raises(MaterialError, match='bad.yaml'):
        materials.load(path)


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(MaterialError, match='nowhere.yaml: cannot be read'):
        materials.load(tmp_path / 'nowhere.yaml')


@given(st.sampled_from(sorted(materials.UNITS)), st.floats(0.001, 1000), st.data())
def test_every_unit_converts_in_proportion(dimension, value, data):
    unit = data.draw(st.sampled_from(sorted(materials.UNITS[dimension])))
    one = parse_quantity(f'1 {unit}', dimension)
    assert parse_quantity(f'{value!r} {unit}', dimension) == pytest.approx(value * one)


def test_a_regime_replaces_some_fields_and_is_checked_like_a_material(tmp_path):
    plain, thin = materials.get('er70s-6'), materials.get('ER70S-6:thin')
    assert thin.layer_height == pytest.approx(1.5e-3)
    assert thin.wire_diameter == plain.wire_diameter
    text = materials.TABLE.read_text().replace('voltage: 20 V', 'voltage: 20 mm')
    bad = tmp_path / 'own.yaml'
    bad.write_text(text)
    with pytest.raises(materials.MaterialError, match="er70s-6.*'voltage'.*must be one of 'V'"):
        materials.load(bad)


@pytest.mark.parametrize('regimes', ['fast', '{fast: 3}', '{fast: {colour: red}}'])
def test_regimes_that_make_no_sense_are_refused(tmp_path, regimes):
    own = tmp_path / 'own.yaml'
    head, _, tail = materials.TABLE.read_text().partition('er4043:')
    own.write_text('er4043:' + tail.partition('316l:')[0] + f'  regimes: {regimes}\n')
    with pytest.raises(materials.MaterialError, match='regime|unknown field'):
        materials.load(own)
