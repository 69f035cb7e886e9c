"""Parse XML files into elements that know their line, and check them against what a reader understands.

The parser is as lenient as those of simulators: it accepts blanks before the declaration and undeclared prefixes.
"""

import re
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

from ...base.confined_paths import read_whole

CHANGES_MOTIONS = re.compile(r":(joint|mimic|deformable\w*|\w+_constraint)$")  # endings of elements with a prefix


class XmlElement(ET.Element):
    """An XML element with the number of its line in the file."""

    line = 0


class ElementRefusal(ValueError):
    """Signal an element that is not supported; the message names it and its line."""

    def __init__(self, e: ET.Element, words: str) -> None:
        name = f" name={e.get('name')!r}" if e.get("name") else ""
        super().__init__(f"line {getattr(e, 'line', 0)}: <{e.tag}{name}>: {words}")


def split_words(text: str) -> frozenset[str]:
    """Return the set of words in a text, separated by blanks."""
    return frozenset(text.split())


@dataclass(frozen=True)
class Vocabulary:
    """The elements and attributes that a reader of a format understands, counts as omitted, or ignores.

    All others are refused. ``named`` maps what is omitted to the words under which it is counted; ``ignored`` changes
    no motion and may contain anything. Both have elements, or elements and attributes within one element (``"link
    gravity"``).
    """

    children: Mapping[str, frozenset[str]]  # children of each element that is read
    attributes: Mapping[str, frozenset[str]] = field(default_factory=dict)
    named: Mapping[str, str] = field(default_factory=dict)
    ignored: frozenset[str] = frozenset()

    def check_element(self, e: ET.Element, omitted: Counter[str], kind: str = "") -> None:
        """Check ``e`` and all elements below it: count in ``omitted`` what is left out, refuse what is unknown.

        ``kind`` is the name of ``e`` in the vocabulary if that is not its tag alone: ``"world physics"`` is the tag of
        the parent and its own. A refusal is an ElementRefusal.
        """
        kind = kind or e.tag
        self._check_attributes(e, kind, omitted)
        for part in e:
            own = f"{kind} {part.tag}"
            if part.tag in self.children.get(kind, ()):
                self.check_element(part, omitted, own if own in self.children else part.tag)
            elif own in self.named or part.tag in self.named:
                omitted[self.named.get(own, self.named.get(part.tag, ""))] += 1
            elif CHANGES_MOTIONS.search(part.tag):
                raise ElementRefusal(part, "an extension that changes which motions are possible is not supported")
            elif ":" in part.tag:
                omitted[f"elements {part.tag}"] += 1
            elif part.tag not in self.ignored:
                raise ElementRefusal(part, f"not supported within {kind}")

    def _check_attributes(self, e: ET.Element, kind: str, omitted: Counter[str]) -> None:
        """Count the omitted attributes of ``e``, an element of this ``kind``, in ``omitted``; refuse an unknown one."""
        known = self.attributes.get(kind, self.attributes.get(e.tag, frozenset()))
        for name in e.attrib:
            if ":" in name or name == "xmlns":
                omitted[f"attributes {name}"] += not name.startswith("xmlns")
            elif f"{e.tag} {name}" in self.named:
                omitted[self.named[f"{e.tag} {name}"]] += 1
            elif name not in known and f"{e.tag} {name}" not in self.ignored:
                expected = f"expected {', '.join(sorted(known))}" if known else "expected none"
                raise ElementRefusal(e, f"attribute {name!r} is not supported; {expected}")


def parse_xml(path: Path) -> ET.Element:
    """Return the root of an XML file; it and all elements below it are ``XmlElement`` with line numbers.

    Raise ValueError with a message of one line if the file is not XML.
    """
    builder, parser = ET.TreeBuilder(element_factory=XmlElement), expat.ParserCreate()
    content = read_whole(path)
    text = content.lstrip() if content[:2] not in (b"\xff\xfe", b"\xfe\xff") else content
    before = content[: len(content) - len(text)].count(b"\n")

    def start_element(tag: str, attributes: dict[str, str]) -> None:
        """Start an element, with the line where its tag starts."""
        builder.start(tag, attributes).line = parser.CurrentLineNumber + before  # type: ignore[attr-defined]

    parser.StartElementHandler, parser.EndElementHandler = start_element, builder.end
    parser.CharacterDataHandler = builder.data
    try:
        parser.Parse(text, True)
    except expat.ExpatError as error:
        line = f"line {error.lineno + before}, column {error.offset + 1}"
        raise ValueError(f"not XML: {expat.ErrorString(error.code)} ({line})") from None
    except ValueError as error:  # an unknown encoding
        raise ValueError(f"not XML: {error}") from None
    return builder.close()


def is_true(e: ET.Element, tag: str, default: str = "false") -> bool:
    """Return the value of the Boolean child element ``tag`` of ``e``, or ``default`` if there is none or it is empty.

    Raise ElementRefusal for any text but true, false, 1 and 0.
    """
    text = (e.findtext(tag) or default).strip().lower()
    if text not in ("true", "1", "false", "0"):
        raise ElementRefusal(next(iter(e.findall(tag)), e), f"expected true or false (got {text!r})")
    return text in ("true", "1")


def take_first(found: Iterable[ET.Element], default: ET.Element) -> ET.Element:
    """Return the first of ``found``, or ``default`` if there is none."""
    return next(iter(found), default)
