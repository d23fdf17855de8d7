"""Cases of clouds in text: headers, separators, decimal signs, encodings, damage."""

from __future__ import annotations

import numpy as np
from reader_case import Case
from reader_clouds import N, is_surface, surface, text

TEXTS = [
    Case(
        'columns z, y, x',
        'a.csv',
        lambda: text(surface()[:, ::-1], ',', 'z,y,x').encode(),
        check=is_surface(),
    ),
    Case(
        'names with units',
        'a.csv',
        lambda: text(surface(), ';', 'X [mm];Y [mm];Z [mm]', True).encode(),
        ('decimal commas',),
        check=is_surface(),
    ),
    Case(
        'intensity before x',
        'a.txt',
        lambda: text(
            np.column_stack([np.full(N, 7), surface()]), '\t', 'Intensity\tX\tY\tZ'
        ).encode(),
        check=is_surface(),
    ),
    Case(
        'normals and colours beside',
        'a.xyz',
        lambda: text(
            np.hstack([surface()[:, [1]], surface()[:, [0]], np.ones((N, 6)), surface()[:, [2]]]),
            ' ',
            'y x nx ny nz r g b z',
        ).encode(),
        check=is_surface(),
    ),
    Case(
        'a header as a comment',
        'a.txt',
        lambda: text(surface()[:, [2, 0, 1]], ' ', f'//Z X Y\n{N}').encode(),
        check=is_surface(),
    ),
    Case(
        'comments',
        'a.xyz',
        lambda: text(surface(), ' ', '# made here\n// of 1,5 points').encode(),
        check=is_surface(),
    ),
    Case(
        'no x, y, z in the header',
        'a.csv',
        lambda: text(surface(), ',', 'a,b,c').encode(),
        ('line 1', 'does not name x, y and z'),
        True,
    ),
    Case('x twice', 'a.csv', lambda: text(surface(), ',', 'x,x,z').encode(), ('x twice',), True),
    Case(
        'the header says metres',
        'a.csv',
        lambda: text(surface() / 1e3, ',', 'X [m],Y [m],Z [m]', form='%.7f').encode(),
        ('says m', '--scale 1'),
        True,
    ),
    Case(
        'unit unknown',
        'a.csv',
        lambda: text(surface(), ',', 'X [ft],Y [ft],Z [ft]').encode(),
        ('units of x, y and z',),
        True,
    ),
    Case(
        'tabs and decimal commas',
        'a.txt',
        lambda: text(surface(), '\t', '', True).encode(),
        ('decimal commas',),
        check=is_surface(),
    ),
    Case(
        'blanks and decimal commas',
        'a.xyz',
        lambda: text(surface(), ' ', '', True).encode(),
        ('decimal commas',),
        check=is_surface(),
    ),
    Case('semicolons', 'a.csv', lambda: text(surface(), ';').encode(), check=is_surface()),
    Case('commas and blanks', 'a.csv', lambda: text(surface(), ', ').encode(), check=is_surface()),
    Case(
        'quoted decimal commas',
        'a.csv',
        lambda: (
            text(surface(), '","', '', True).replace('\n', '"\n"').encode().join([b'"', b''])[:-1]
        ),
        ('decimal commas',),
        check=is_surface(),
    ),
    Case(
        'trailing separators',
        'a.csv',
        lambda: text(surface(), ';', 'x;y;z;', end=';\n').replace('z;;', 'z;').encode(),
        check=is_surface(),
    ),
    Case(
        'empty fields',
        'a.csv',
        lambda: text(surface(), ';', 'x;y;z').replace('\n200.5000;', '\n;').encode(),
        ('61 points without a finite',),
        check=is_surface(N - 61),
    ),
    Case(
        'decimal or separating commas',
        'a.csv',
        lambda: text(np.round(surface()), ',', '', form='%d,5').encode(),
        ('line 1', 'decimal commas'),
        True,
    ),
    Case(
        'three names, six columns',
        'a.csv',
        lambda: text(surface(), ',', 'x,y,z', True).encode(),
        ('line', 'comma|columns'),
        True,
    ),
    Case(
        'thousands with points',
        'a.csv',
        lambda: text(surface(), ';', 'x;y;z', True).replace('\n200,5', '\n1.200,5').encode(),
        ('line [0-9]+', 'thousands'),
        True,
    ),
    Case(
        'thousands with commas',
        'a.csv',
        lambda: text(surface(), ';', 'x;y;z').replace('\n200.5', '\n1,200.5').encode(),
        ('line [0-9]+', 'thousands'),
        True,
    ),
    Case(
        'thousands with blanks',
        'a.csv',
        lambda: text(surface(), ';', 'x;y;z', True).replace('\n200,5', '\n1 200,5').encode(),
        ('line [0-9]+', 'thousands'),
        True,
    ),
    Case(
        'comma with three digits',
        'a.csv',
        lambda: text(surface() + (0, 300, 100), ';', '', True, form='%.3f').encode(),
        ('decimal comma or a separator of thousands',),
        True,
    ),
    Case(
        'a row too short',
        'a.xyz',
        lambda: text(surface()).replace('\n200.5000', '\n', 1).encode(),
        ('line 2: 2 columns',),
        True,
    ),
    Case(
        'cut off', 'a.xyz', lambda: text(surface()).encode()[:-12], (f'line {N}: 2 columns',), True
    ),
    Case(
        'a word',
        'a.xyz',
        lambda: text(surface()).replace('\n200.5000', '\nhello', 1).encode(),
        ("line 2: 'hello' is no number",),
        True,
    ),
    Case(
        'decimal commas and points',
        'a.csv',
        lambda: text(surface(), ';', '', True).replace('\n200,5000', '\n200.5', 1).encode(),
        ('line 2', 'decimal point'),
        True,
    ),
    Case(
        'a byte order mark',
        'a.csv',
        lambda: text(surface(), ',', 'x,y,z').encode('utf-8-sig'),
        check=is_surface(),
    ),
    Case(
        'UTF-16',
        'a.csv',
        lambda: text(surface()[:, ::-1], ';', 'Z;Y;X').encode('utf-16'),
        check=is_surface(),
    ),
    Case('CR alone', 'a.xyz', lambda: text(surface(), end='\r').encode(), check=is_surface()),
    Case(
        'too many announced',
        'a.xyz',
        lambda: text(surface(), ' ', '9999').encode(),
        ('9999 points are announced',),
        True,
    ),
    Case(
        'columns without names',
        'a.xyz',
        lambda: text(np.hstack([surface(), surface()])).encode(),
        ('first 3 of 6',),
        check=is_surface(),
    ),
]
