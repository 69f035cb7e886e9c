"""Decide which characters names may contain, and make other text safe for a terminal or a page."""

import unicodedata

WRITTEN = ("L", "M", "N", "P", "S", "Zs")  # letters, marks, numbers, punctuation, symbols, spaces, of any script
SOFT_HYPHEN = "\N{SOFT HYPHEN}"
NAMES = {"\t": "tab", "\n": "newline", "\r": "carriage return", "\x1b": "escape"}


def is_accepted(character: str) -> bool:
    """Return whether a name may contain a character.

    Control characters are not accepted, nor those that change the order of others or are invisible: U+200B to U+200F,
    U+202A to U+202E, U+2066 to U+2069, U+FEFF and their like.
    """
    return character == SOFT_HYPHEN or unicodedata.category(character).startswith(WRITTEN)


def find_unaccepted(text: str) -> str:
    """Return the first character that a name may not contain, in words such as ``U+0009 (tab)``; empty if none."""
    if text.isascii() and text.isprintable():  # in one pass: a table of runs has some hundred thousand names
        return ""
    character = next((c for c in text if not is_accepted(c)), "")
    known = NAMES.get(character) or (unicodedata.name(character, "").lower() if character else "")
    return f"U+{ord(character):04X}{f' ({known})' * bool(known)}" if character else ""


def check_text(what: str, text: object) -> str:
    """Return ``text`` if it may name something; raise ValueError otherwise, with ``what`` in the message."""
    if not isinstance(text, str):
        raise ValueError(f"{what} must be text (got {text!r})")
    if found := find_unaccepted(text):
        raise ValueError(f"{what} must not contain {found} (got {text!r})")
    return text


def escape_text(text: str) -> str:
    """Return ``text`` with all characters escaped that a terminal might obey: all but accepted ones, tabs, newlines."""
    return "".join(c if is_accepted(c) or c in "\t\n" else c.encode("unicode_escape").decode() for c in text)
