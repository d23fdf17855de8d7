"""Small XML files as elements that know their line. No document types, no entities, no attributes, bounded size."""

from __future__ import annotations

from dataclasses import dataclass, field
from xml.parsers import expat

LARGEST = 1_000_000  # bytes
DEEPEST = 20


class XmlError(ValueError):
    """What is wrong in a file, and in which line."""

    def __init__(self, line: int, text: str) -> None:
        super().__init__(f'line {line}: {text}')
        self.line = line


@dataclass
class Element:
    """name, line where it begins, text inside it, elements inside it."""

    name: str
    line: int
    text: str = ''
    inner: list[Element] = field(default_factory=list)


def parse(data: bytes | str) -> Element:
    """The root element. XmlError for everything that cannot be read."""
    raw = data.encode('utf-8', 'surrogatepass') if isinstance(data, str) else data
    if len(raw) > LARGEST:
        raise XmlError(1, f'{len(raw)} bytes; such a file has at most {LARGEST}')
    builder = _Builder()
    try:
        builder.parser.Parse(raw, True)
    except expat.ExpatError as e:
        raise XmlError(e.lineno, expat.errors.messages.get(e.code, 'no XML')) from None
    except (LookupError, ValueError) as e:  # unknown encodings
        if isinstance(e, XmlError):
            raise
        raise XmlError(1, f'cannot be read ({e})') from None
    if builder.root is None:
        raise XmlError(1, 'no element')
    return builder.root


class _Builder:
    def __init__(self) -> None:
        self.root: Element | None = None
        self.stack: list[Element] = []
        self.parser = expat.ParserCreate()
        self.parser.StartElementHandler = self._start
        self.parser.EndElementHandler = self._end
        self.parser.CharacterDataHandler = self._text
        self.parser.StartDoctypeDeclHandler = self._doctype

    @property
    def line(self) -> int:
        return self.parser.CurrentLineNumber

    def _start(self, name: str, attributes: dict[str, str]) -> None:
        if attributes:
            raise XmlError(self.line, f'<{name}> has attributes; values stand between the tags')
        if len(self.stack) >= DEEPEST:
            raise XmlError(self.line, f'elements are nested more than {DEEPEST} deep')
        element = Element(name, self.line)
        if self.stack:
            self.stack[-1].inner.append(element)
        else:
            self.root = element
        self.stack.append(element)

    def _end(self, _name: str) -> None:
        self.stack.pop()

    def _text(self, text: str) -> None:
        self.stack[-1].text += text

    def _doctype(self, *_: object) -> None:
        raise XmlError(self.line, 'document types and entities are not read')
