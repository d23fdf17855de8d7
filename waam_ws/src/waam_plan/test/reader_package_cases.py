"""Cases of 3MF: parts in several files, kinds of objects, parts of slicers, transforms, hostile packages."""

from __future__ import annotations

from collections.abc import Callable

from reader_case import Case
from reader_meshes import FULL, box, holds, inside_out
from reader_packages import (
    ENTITIES,
    SMALL,
    bambu,
    bomb,
    component,
    encrypted,
    mesh,
    model,
    nested,
    obj,
    package,
    prusa,
    small,
    split,
    twice,
)


def one(
    about: str,
    data: Callable[[], bytes],
    volume: float,
    bodies: int = 1,
    words: tuple[str, ...] = (),
) -> Case:
    return Case(about, 'a.3mf', data, words, check=holds(volume, bodies))


def bad(about: str, data: Callable[[], bytes], *words: str) -> Case:
    return Case(about, 'a.3mf', data, words, True)


def plain(
    resources: str, items: str = '<item objectid="1"/>', more: str = ''
) -> Callable[[], bytes]:
    return lambda: package(model(resources, items, more))


TWO = '<item objectid="1"/><item objectid="2" {}/>'
MIRROR = 'transform="-1 0 0 0 1 0 0 0 1 100 0 0"'
CASES = [
    one('one object', plain(obj(1, mesh())), FULL),
    one('inches', plain(obj(1, mesh()), more='unit="inch"'), FULL * 25.4**3),
    one('a mirrored item', plain(obj(1, mesh()), f'<item objectid="1" {MIRROR}/>'), FULL),
    one(
        'a mirrored component of a mirrored item',
        plain(obj(1, mesh()) + obj(2, component(1, MIRROR)), f'<item objectid="2" {MIRROR}/>'),
        FULL,
    ),
    one('the mesh in another part', lambda: split(2), FULL),
    one('the mesh in another part, the same id', lambda: split(1), FULL),
    one('another object of the same id', lambda: split(2, other=obj(1, mesh(small()))), FULL),
    bad(
        'a part that is not there',
        lambda: split(2, '/3D/Objects/b.model'),
        '3d/objects/b.model',
        'not in the archive',
    ),
    bad(
        'a path out of the archive',
        lambda: split(2, '/../../etc/passwd'),
        'etc/passwd',
        'not in the archive',
    ),
    one(
        'the start part of _rels/.rels',
        lambda: package(
            model(obj(1, mesh(small()))),
            '/other/start.model',
            other__start_dot_model=model(obj(1, mesh())),
        ),
        FULL,
    ),
    bad(
        'two models and no _rels/.rels',
        lambda: package(model(obj(1, mesh())), '', other__b_dot_model=model(obj(1, mesh()))),
        '_rels/.rels',
    ),
    bad(
        'a start part that is not there',
        lambda: package(model(obj(1, mesh())), '/3D/gone.model'),
        '3d/gone.model',
        'not in the archive',
    ),
    one(
        'an object of type support',
        plain(obj(1, mesh()) + obj(2, mesh(small()), 'type="support"'), TWO.format('')),
        FULL,
        words=('left out: 1 objects of type support',),
    ),
    one(
        'an object of type other',
        plain(obj(1, mesh()) + obj(2, mesh(small()), 'type="other"'), TWO.format('')),
        FULL,
        words=('type other',),
    ),
    one(
        'components of type solidsupport',
        plain(
            obj(1, mesh())
            + obj(2, mesh(small()), 'type="solidsupport"')
            + obj(3, '<components><component objectid="1"/><component objectid="2"/></components>'),
            '<item objectid="3"/>',
        ),
        FULL,
        words=('type solidsupport',),
    ),
    bad(
        'nothing but supports',
        plain(obj(1, mesh(), 'type="support"')),
        'no object with a mesh',
        'type support',
    ),
    bad(
        'a type that is not known',
        plain(obj(1, mesh(), 'type="ghost"')),
        'object 1',
        "'ghost' is not known",
    ),
    one(
        'printable="0"',
        plain(obj(1, mesh()) + obj(2, mesh(small())), TWO.format('printable="0"')),
        FULL,
        words=('1 items that are switched off',),
    ),
    bad(
        'nothing printable',
        plain(obj(1, mesh()), '<item objectid="1" printable="0"/>'),
        'switched off',
    ),
    bad('an empty build', plain(obj(1, mesh()), ''), 'the build is empty'),
    one('Prusa: a second part', lambda: prusa('ModelPart'), FULL + SMALL, 2),
    one(
        'Prusa: a modifier',
        lambda: prusa('ParameterModifier'),
        FULL,
        words=('1 volumes of the slicer: modifier',),
    ),
    one(
        'Prusa: a support blocker',
        lambda: prusa('SupportBlocker'),
        FULL,
        words=('support blocker',),
    ),
    one(
        'Prusa: a support enforcer',
        lambda: prusa('SupportEnforcer'),
        FULL,
        words=('support enforcer',),
    ),
    bad(
        'Prusa: a negative volume', lambda: prusa('NegativeVolume'), "'second' is a negative volume"
    ),
    bad('Prusa: another kind', lambda: prusa('Ghost'), "kind 'ghost'"),
    one('Orca: a modifier', lambda: bambu('modifier_part'), FULL, words=('modifier',)),
    one(
        'Orca: a support blocker',
        lambda: bambu('support_blocker'),
        FULL,
        words=('support blocker',),
    ),
    bad('Orca: a negative part', lambda: bambu('negative_part'), "'second' is a negative volume"),
    one(
        'Cura: an infill mesh',
        plain(
            obj(1, mesh())
            + obj(
                2,
                '<metadatagroup><metadata name="cura:infill_mesh">True</metadata></metadatagroup>'
                + mesh(small()),
            ),
            TWO.format(''),
        ),
        FULL,
        words=('cura:infill_mesh',),
    ),
    one(
        'Cura: no infill mesh',
        plain(
            obj(1, mesh())
            + obj(
                2,
                '<metadatagroup><metadata name="cura:infill_mesh">False</metadata></metadatagroup>'
                + mesh(small()),
            ),
            TWO.format(''),
        ),
        FULL + SMALL,
        2,
    ),
    one('required: materials', plain(obj(1, mesh()), more='requiredextensions="m p"'), FULL),
    bad(
        'required: not known',
        plain(obj(1, mesh()), more='requiredextensions="b"'),
        'requires the extension b',
        'beamlattice',
    ),
    bad(
        'required: not declared',
        plain(obj(1, mesh()), more='requiredextensions="zz"'),
        'requires the extension zz',
    ),
    bad(
        'a lattice of beams',
        plain(obj(1, mesh(more='<b:beamlattice minlength="1"/>'))),
        'object 1',
        'beamlattice',
    ),
    bad('an object of another kind', plain(obj(1, '<b:implicit/>')), 'object 1', 'implicit'),
    bad('ten components on 15 levels', lambda: nested(15, 10), 'components of components'),
    one(
        'two components on 3 levels',
        lambda: package(
            model(
                obj(1, mesh()) + obj(2, component(1)) + obj(3, component(2)), '<item objectid="3"/>'
            )
        ),
        FULL,
    ),
    bad(
        'a component of itself',
        plain(obj(1, component(2)) + obj(2, component(1))),
        'component of itself',
    ),
    bad('an object that is not there', plain(obj(1, component(7))), 'object 7'),
    bad(
        'two objects of one id',
        plain(obj(1, mesh()) + obj(1, mesh(small()))),
        'object 1 is there twice',
    ),
    bad(
        'decimal commas',
        lambda: package(model(obj(1, mesh(box((60.5, 40, 20))).replace('60.5', '60,5')))),
        'object 1, vertex',
        'decimal comma',
    ),
    bad(
        'decimal commas in a transform',
        plain(obj(1, mesh()), '<item objectid="1" transform="1 0 0 0 1 0 0 0 1 0,5 0 0"/>'),
        'transform of object 1',
        'decimal comma',
    ),
    bad(
        'a flat transform',
        plain(obj(1, mesh()), '<item objectid="1" transform="1 0 0 0 1 0 0 0 0 0 0 0"/>'),
        'object 1',
        'makes it flat',
    ),
    bad(
        'a body inside out',
        plain(obj(1, mesh()) + obj(2, mesh(inside_out(small()))), TWO.format('')),
        'body 2 of 2',
        'inside out',
    ),
    bad(
        'a vertex that is not there',
        plain(obj(1, mesh().replace('v1="0"', 'v1="99"', 1))),
        'object 1',
        'not there',
    ),
    bad('an encrypted archive', encrypted, 'encrypted'),
    bad('an entry twice', twice, 'twice'),
    bad('a bomb of blanks', bomb, '3d/3dmodel.model', 'packed'),
    bad('a bomb of entities', lambda: package(ENTITIES + model(obj(1, mesh()))), 'document type'),
    bad(
        'a bomb of entities in UTF-16',
        lambda: package(
            ('<?xml version="1.0" encoding="UTF-16"?>' + ENTITIES + model(obj(1, mesh()))).encode(
                'utf-16'
            )
        ),
        'document type',
    ),
    bad(
        'a bomb of entities in the settings',
        lambda: package(model(obj(1, mesh())), Metadata__a_dot_config=ENTITIES + '<config/>'),
        'document type',
    ),
    bad('elements without end', lambda: package('<a>' * 50000), 'within each other'),
    bad(
        'a name with ..',
        lambda: package(model(obj(1, mesh())), **{'3D__..__..__x': 'a'}),
        'no name of a part',
    ),
    bad('cut off', lambda: package(model(obj(1, mesh())))[:400], 'archive'),
]
