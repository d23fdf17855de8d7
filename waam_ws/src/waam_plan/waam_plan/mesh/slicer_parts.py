"""What slicers say about the meshes of a 3MF in files of their own: parts, modifiers, negative volumes, supports.

PrusaSlicer writes volumes as ranges of triangles (`Metadata/Slic3r_PE_model.config`), Bambu Studio and OrcaSlicer
name components (`Metadata/model_settings.config`).
"""

from __future__ import annotations

from dataclasses import dataclass, field

from waam_plan.mesh.package import Package, parse
from waam_plan.texts import shown

PARTS = {'modelpart', 'normal_part', ''}
NEGATIVE = {'negativevolume', 'negative_part'}
LEFT_OUT = {
    'parametermodifier': 'modifier', 'modifier_part': 'modifier',
    'supportblocker': 'support blocker', 'support_blocker': 'support blocker',
    'supportenforcer': 'support enforcer', 'support_enforcer': 'support enforcer',
}  # fmt: skip


@dataclass
class Piece:
    """A part of an object. kind: as the slicer spells it, small. first, last: triangles of the object, -1 = all."""

    kind: str = ''
    name: str = ''
    first: int = -1
    last: int = -1

    @property
    def left_out(self) -> str:
        """What it is in plain words, '' for metal. ValueError for what cannot be left out."""
        if self.kind in PARTS:
            return ''
        if self.kind in NEGATIVE:
            raise ValueError(
                f"'{shown(self.name)}' is a negative volume of a slicer: cut it out of the part there, and export again"
            )
        if self.kind not in LEFT_OUT:
            raise ValueError(
                f"'{shown(self.name)}' is a volume of kind '{shown(self.kind)}', which is not known"
            )
        return LEFT_OUT[self.kind]


@dataclass
class Pieces:
    """ranges: of an object's own triangles, by its id. components: by id of the object and of the component."""

    ranges: dict[str, list[Piece]] = field(default_factory=dict)
    components: dict[tuple[str, str], Piece] = field(default_factory=dict)


def pieces_of(package: Package) -> Pieces:
    """Of every XML file in Metadata/*.config. ValueError names file and fault."""
    out = Pieces()
    for name in package.names:
        if name.startswith('metadata/') and name.endswith('.config'):
            text = package.read(name)
            if text.lstrip(b'\xef\xbb\xbf \t\r\n').startswith(b'<'):
                _Reader(name, out).read(text)
    return out


class _Reader:
    def __init__(self, name: str, out: Pieces) -> None:
        self.name, self.out = name, out
        self.object = ''
        self.piece: Piece | None = None

    def read(self, text: bytes) -> None:
        parse([text], self.name, self.begin, self.close)

    def begin(self, tag: str, attributes: dict[str, str]) -> None:
        if tag == 'object':
            self.object = attributes.get('id', '')
        elif tag == 'volume' and self.object:
            first, last = (_whole(attributes.get(a, '')) for a in ('firstid', 'lastid'))
            self.piece = Piece(first=first, last=last)
            self.out.ranges.setdefault(self.object, []).append(self.piece)
        elif tag == 'part' and self.object:
            self.piece = Piece(attributes.get('subtype', '').lower())
            self.out.components[self.object, attributes.get('id', '')] = self.piece
        elif tag == 'metadata' and self.piece is not None:
            key, value = attributes.get('key', ''), attributes.get('value', '')
            if key == 'name':
                self.piece.name = value
            elif key == 'volume_type':
                self.piece.kind = value.lower()
            elif key == 'modifier' and value == '1' and not self.piece.kind:
                self.piece.kind = 'parametermodifier'

    def close(self, tag: str) -> None:
        if tag in ('volume', 'part'):
            self.piece = None
        elif tag == 'object':
            self.object = ''


def _whole(text: str) -> int:
    if not text.isascii() or not text.isdigit() or len(text) > 12:
        raise ValueError(f"'{shown(text)}' is no number of a triangle")
    return int(text)
