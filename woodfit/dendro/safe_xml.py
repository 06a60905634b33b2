"""XML read without what makes it dangerous: no document type, so no entities and nothing fetched; limits on size."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from xml.parsers import expat

from woodfit.dendro.series import FormatError
from woodfit.dendro.text import check_size, error, excerpt

MAX_DEPTH = 64
MAX_ELEMENTS = 500_000


@dataclass(slots=True)
class Element:
    """One element; names of elements and attributes are local, without their namespace."""

    name: str
    namespace: str
    attributes: dict[str, str]
    line: int
    children: list[Element] = field(default_factory=list)
    text: str = ""

    def all(self, name: str) -> Iterator[Element]:
        """Children of a name."""
        return (child for child in self.children if child.name == name)

    def first(self, *path: str) -> Element | None:
        """First child of a name, first child of that, and so on."""
        found: Element | None = self
        for name in path:
            found = None if found is None else next(found.all(name), None)
        return found


def parse(data: str | bytes, source: str) -> Element:
    """Read a document into its root element.

    Parameters
    ----------
    data : str or bytes
        Bytes are decoded as their XML declaration says.
    source : str
        Name, for messages.

    Raises
    ------
    FormatError
        For broken XML, a document type (the place of entities and external references), nesting deeper than
        `MAX_DEPTH` and more than `MAX_ELEMENTS` elements.
    """
    check_size(len(data), source)
    reader = _Reader(source)
    try:
        reader.parser.Parse(data, True)
    except expat.ExpatError as reason:
        raise error(
            source, reason.lineno, f"broken XML ({expat.ErrorString(reason.code)})", "a well-formed document"
        ) from None
    except (LookupError, UnicodeError, ValueError) as reason:
        if isinstance(reason, FormatError):
            raise
        raise error(source, 1, f"an unreadable encoding ({reason})", "UTF-8", "save it again as UTF-8") from None
    if reader.root is None:
        raise error(source, None, "no element", "an XML document")
    return reader.root


class _Reader:
    """Builds elements from the parser's events."""

    def __init__(self, source: str) -> None:
        self.source = source
        self.root: Element | None = None
        self.open: list[Element] = []
        self.pieces: list[list[str]] = []
        self.count = 0
        self.parser = expat.ParserCreate(namespace_separator=" ")
        self.parser.buffer_text = True
        self.parser.StartDoctypeDeclHandler = self.refuse_doctype
        self.parser.StartElementHandler = self.start
        self.parser.EndElementHandler = self.end
        self.parser.CharacterDataHandler = self.data

    def refuse_doctype(self, name: str, *_: object) -> None:
        raise error(
            self.source, self.parser.CurrentLineNumber, f"the document type {excerpt(name)}", "none",
            "entities and external references are not read; remove the DOCTYPE",
        )  # fmt: skip

    def start(self, name: str, attributes: dict[str, str]) -> None:
        self.count += 1
        line = self.parser.CurrentLineNumber
        if len(self.open) >= MAX_DEPTH:
            raise error(self.source, line, f"elements nested deeper than {MAX_DEPTH}", "fewer levels")
        if self.count > MAX_ELEMENTS:
            raise error(self.source, line, f"more than {MAX_ELEMENTS} elements", "fewer", "split the file")
        namespace, _, local = name.rpartition(" ")
        element = Element(local, namespace, {key.rpartition(" ")[2]: value for key, value in attributes.items()}, line)
        if self.open:
            self.open[-1].children.append(element)
        else:
            self.root = element
        self.open.append(element)
        self.pieces.append([])

    def end(self, name: str) -> None:
        self.open.pop().text = "".join(self.pieces.pop()).strip()

    def data(self, text: str) -> None:
        if self.pieces:
            self.pieces[-1].append(text)
