"""Elements of XML files that know their line, and lists of what a reader understands of them.

The parser is as lenient as those of simulators: blanks before the declaration, prefixes that are declared nowhere.
"""

import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

from ..places import read_whole


class Element(ET.Element):
    """An element that knows its line."""

    line = 0


class Refusal(ValueError):
    """An element that is not taken over."""

    def __init__(self, e: ET.Element, words: str) -> None:
        name = f" name={e.get('name')!r}" if e.get("name") else ""
        super().__init__(f"line {getattr(e, 'line', 0)}: <{e.tag}{name}>: {words}")


def words(text: str) -> frozenset[str]:
    """The words of a text."""
    return frozenset(text.split())


@dataclass(frozen=True)
class Vocabulary:
    """What a reader of a format understands, names as left out, and passes over; all else is refused.

    ``named`` are left out and counted under their words, ``ignored`` change no motion and may hold anything.
    """

    children: Mapping[str, frozenset[str]]  # of each element that is read
    attributes: Mapping[str, frozenset[str]] = field(default_factory=dict)
    named: Mapping[str, str] = field(default_factory=dict)
    ignored: frozenset[str] = frozenset()

    def check(self, e: ET.Element, omitted: Counter[str], kind: str = "") -> None:
        """Count what ``e`` and all below it have that is left out; Refusal of what is in no list."""
        kind = kind or e.tag
        self._check_attributes(e, kind, omitted)
        for part in e:
            own = f"{kind} {part.tag}"
            if part.tag in self.children.get(kind, ()):
                self.check(part, omitted, own if own in self.children else part.tag)
            elif own in self.named or part.tag in self.named:
                omitted[self.named.get(own, self.named.get(part.tag, ""))] += 1
            elif ":" in part.tag:
                omitted[f"elements {part.tag}"] += 1
            elif part.tag not in self.ignored:
                raise Refusal(part, f"not taken over within {kind}")

    def _check_attributes(self, e: ET.Element, kind: str, omitted: Counter[str]) -> None:
        known = self.attributes.get(kind, self.attributes.get(e.tag, frozenset()))
        for name in e.attrib:
            if ":" in name or name == "xmlns":
                omitted[f"attributes {name}"] += not name.startswith("xmlns")
            elif name not in known:
                expected = f"expected {', '.join(sorted(known))}" if known else "expected none"
                raise Refusal(e, f"attribute {name!r} is not taken over; {expected}")


def parse(path: Path) -> ET.Element:
    """The root of a file, or ValueError in one line."""
    builder, parser = ET.TreeBuilder(element_factory=Element), expat.ParserCreate()
    content = read_whole(path)
    text = content.lstrip() if content[:2] not in (b"\xff\xfe", b"\xfe\xff") else content
    before = content[: len(content) - len(text)].count(b"\n")

    def begin(tag: str, attributes: dict[str, str]) -> None:
        builder.start(tag, attributes).line = parser.CurrentLineNumber + before  # type: ignore[attr-defined]

    parser.StartElementHandler, parser.EndElementHandler = begin, builder.end
    parser.CharacterDataHandler = builder.data
    try:
        parser.Parse(text, True)
    except expat.ExpatError as error:
        line = f"line {error.lineno + before}, column {error.offset + 1}"
        raise ValueError(f"not XML: {expat.ErrorString(error.code)} ({line})") from None
    except ValueError as error:  # an encoding that is none
        raise ValueError(f"not XML: {error}") from None
    return builder.close()


def is_true(e: ET.Element, tag: str, default: str = "false") -> bool:
    """A Boolean child of ``e``, or Refusal."""
    text = (e.findtext(tag) or default).strip().lower()
    if text not in ("true", "1", "false", "0"):
        raise Refusal(next(iter(e.findall(tag)), e), f"expected true or false (got {text!r})")
    return text in ("true", "1")


def first(found: Iterable[ET.Element], default: ET.Element) -> ET.Element:
    """The first of ``found``, else ``default``."""
    return next(iter(found), default)
