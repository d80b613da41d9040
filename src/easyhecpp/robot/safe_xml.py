"""XML from strangers: parsed only when it cannot expand or fetch anything."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path
from xml.parsers import expat

from easyhecpp.errors import InputError


def parse_xml(data: bytes, path: Path) -> ET.Element:
    """Root element of an XML text; `path` is only used in error texts."""
    refuse_dtd(data, path)
    try:
        return ET.fromstring(data)
    except ET.ParseError as error:
        raise _not_xml(error, path) from error


class _PrologEndedError(Exception):
    """Stops the parser at the first element: a declaration can only stand before it."""


def refuse_dtd(data: bytes, path: Path) -> None:
    """Refuse XML with a document type declaration, before any entity in it can expand.

    Neither URDF nor COLLADA needs one, and entities are how a small file fills the memory or
    reads other files.
    """

    def on_doctype(*_: object) -> None:
        raise InputError(
            "The file has a document type declaration (<!DOCTYPE ...>), which is refused because "
            "entities in it could expand without end or read other files",
            where=path,
            expected="plain XML without <!DOCTYPE> and <!ENTITY>",
            fix="Remove the declaration and write its entities out",
        )

    def on_element(*_: object) -> None:
        raise _PrologEndedError

    parser = expat.ParserCreate()
    parser.StartDoctypeDeclHandler = on_doctype
    parser.StartElementHandler = on_element
    try:
        parser.Parse(data, True)
    except _PrologEndedError:
        return
    except (expat.ExpatError, ValueError, LookupError) as error:
        raise _not_xml(error, path) from error


def _not_xml(error: Exception, path: Path) -> InputError:
    return InputError(f"The file is not valid XML: {error}", where=path, expected="an XML file")
