"""3MF packages made here: parts in several files, parts of slicers, hostile packages."""

from __future__ import annotations

import io
import zipfile

from reader_meshes import box

CORE = 'http://schemas.microsoft.com/3dmanufacturing/core/2015/02'
NAMES = (
    f'xmlns="{CORE}" xmlns:p="http://schemas.microsoft.com/3dmanufacturing/production/2015/06" '
    'xmlns:m="http://schemas.microsoft.com/3dmanufacturing/material/2015/02" '
    'xmlns:b="http://schemas.microsoft.com/3dmanufacturing/beamlattice/2017/02"'
)
RELS = (
    '<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships"><Relationship Target="{}" '
    'Id="rel0" Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/></Relationships>'
)
START = '3D/3dmodel.model'
SMALL = 20 * 20 * 10


def mesh(m=None, more: str = '') -> str:
    m = m or box()
    vertices = ''.join(f'<vertex x="{x:.6f}" y="{y:.6f}" z="{z:.6f}"/>' for x, y, z in m.vertices)
    faces = ''.join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in m.faces)
    return f'<mesh><vertices>{vertices}</vertices><triangles>{faces}</triangles>{more}</mesh>'


def obj(number: int, inner: str, more: str = '') -> str:
    return f'<object id="{number}" {more}>{inner}</object>'


def model(resources: str, items: str = '<item objectid="1"/>', more: str = '') -> str:
    more = more if 'unit=' in more else f'unit="millimeter" {more}'
    return f'<model {more} {NAMES}><resources>{resources}</resources><build>{items}</build></model>'


def component(number: int, more: str = '') -> str:
    return f'<components><component objectid="{number}" {more}/></components>'


def package(start: str | None = None, rels: str = '/' + START, **more: str | bytes) -> bytes:
    """more: parts by name, '__' for '/' and '_dot_' for '.'."""
    out = io.BytesIO()
    with zipfile.ZipFile(out, 'w', zipfile.ZIP_DEFLATED) as z:
        z.writestr('[Content_Types].xml', '<Types/>')
        if rels:
            z.writestr('_rels/.rels', RELS.format(rels))
        if start is not None:
            z.writestr(START, start)
        for name, text in more.items():
            z.writestr(name.replace('__', '/').replace('_dot_', '.'), text)
    return out.getvalue()


def small(at: tuple[float, float, float] = (80, 0, 0)):
    return box((20, 20, 10), at)


def prusa(kind: str) -> bytes:
    """The second box of one object is of another kind."""
    m = mesh_of_two()
    config = (
        '<config><object id="1"><metadata type="object" key="name" value="all"/>'
        '<volume firstid="0" lastid="11"><metadata type="volume" key="name" value="main"/><metadata type="volume" '
        'key="volume_type" value="ModelPart"/></volume><volume firstid="12" lastid="23"><metadata type="volume" '
        f'key="name" value="second"/><metadata type="volume" key="volume_type" value="{kind}"/></volume>'
        '</object></config>'
    )
    return package(model(obj(1, m)), Metadata__Slic3r_PE_model_dot_config=config)


def mesh_of_two() -> str:
    from reader_meshes import both

    return mesh(both(box(), small()))


def bambu(kind: str) -> bytes:
    parts = '<components><component objectid="1"/><component objectid="2"/></components>'
    config = (
        '<config><object id="3"><metadata key="name" value="all"/><part id="1" subtype="normal_part"/>'
        f'<part id="2" subtype="{kind}"><metadata key="name" value="second"/></part></object></config>'
    )
    start = model(obj(1, mesh()) + obj(2, mesh(small())) + obj(3, parts), '<item objectid="3"/>')
    return package(start, Metadata__model_settings_dot_config=config)


def split(number: int, path: str = '/3D/Objects/a.model', other: str = '') -> bytes:
    """The mesh lies in another part, as object 1."""
    start = model(
        other + obj(number, component(1, f'p:path="{path}" p:UUID="6f1a"'), 'p:UUID="aa"'),
        f'<item objectid="{number}" p:UUID="bb"/>', 'requiredextensions="p"',
    )  # fmt: skip
    return package(start, **{'3D__Objects__a_dot_model': model(obj(1, mesh()), '')})


def nested(levels: int, each: int) -> bytes:
    """Every object has `each` components of the level below."""
    inner = ''.join(
        obj(i + 1, '<components>' + f'<component objectid="{i}"/>' * each + '</components>')
        for i in range(1, levels + 1)
    )
    return package(model(obj(1, mesh()) + inner, f'<item objectid="{levels + 1}"/>'))


def encrypted() -> bytes:
    data = bytearray(package(model(obj(1, mesh()))))
    at = 0
    while (at := data.find(b'PK\x01\x02', at)) >= 0:
        data[at + 8] |= 1
        at += 4
    at = 0
    while (at := data.find(b'PK\x03\x04', at)) >= 0:
        data[at + 6] |= 1
        at += 4
    return bytes(data)


def twice() -> bytes:
    out = io.BytesIO(package(model(obj(1, mesh()))))
    with zipfile.ZipFile(out, 'a') as z:
        import warnings

        with warnings.catch_warnings():
            warnings.simplefilter('ignore')
            z.writestr(START, model(obj(1, mesh(small()))))
    return out.getvalue()


def bomb() -> bytes:
    """200 MB of blanks in 0.2 MB."""
    out = io.BytesIO()
    with zipfile.ZipFile(out, 'w', zipfile.ZIP_DEFLATED, compresslevel=1) as z:
        z.writestr('_rels/.rels', RELS.format('/' + START))
        with z.open(START, 'w', force_zip64=True) as f:
            for _ in range(200):
                f.write(b' ' * 1_000_000)
    return out.getvalue()


ENTITIES = '<!DOCTYPE m [<!ENTITY a "aaaaaaaaaa">' + ''.join(
    f'<!ENTITY {chr(98 + i)} "{f"&{chr(97 + i)};" * 10}">' for i in range(9)
) + ']>'  # fmt: skip
