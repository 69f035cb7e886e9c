"""List every place of each kind of thing that this project wants to have once: ``python docs/list_kinds.py``.

A pattern for each kind reads the syntax trees of the product, and ``docs/kinds.toml`` says of each place why it stays.
The command fails where a place that a pattern finds is not in that file, or a place of that file is gone.
``--new`` prints the lines that are missing there. The reason of a place begins with one of

    plain:, reference:, judge:, checker:    it is on its own on purpose, as an independent second text: not counted
    other:                                  the pattern finds it, and it is something else: not counted
    any other words                         counted, and stays
    nothing                                 counted, and is to be merged with another place
"""

import sys
import tomllib
from collections.abc import Iterator
from functools import cache
from typing import Any

from kind_patterns import FINDERS  # type: ignore[import-not-found]  # beside this file
from syntax_trees import ROOT, Place, list_bodies, read_modules  # type: ignore[import-not-found]

DATA = ROOT / "docs" / "kinds.toml"
APART = ("plain:", "reference:", "judge:", "checker:")
OTHER = "other:"


@cache
def find_places(kind: str) -> dict[str, Place]:
    """Return the places that the pattern of a kind finds, by key; several in one function are one."""
    out: dict[str, Place] = {}
    for module in read_modules():
        for name, line in FINDERS[kind](module):
            place = Place(module.path, name, line)
            out.setdefault(place.key, place)
    return out


def find_by_name(key: str) -> Place | None:
    """Return the place of a key of ``kinds.toml``, whether or not a pattern finds it; None if it no longer exists."""
    path, _, wanted = key.partition(" ")
    found = [
        scope for m in read_modules() if m.path == path for name, scope, _ in list_bodies(m.tree) if name == wanted
    ]
    return Place(path, wanted, getattr(found[0], "lineno", 1)) if found else None


def read_reasons() -> dict[str, dict[str, str]]:
    """Return why each place stays, by kind and key."""
    data: dict[str, Any] = tomllib.loads(DATA.read_text(encoding="utf-8")) if DATA.exists() else {}
    return {kind: data.get(kind, {}) for kind in FINDERS}


def list_faults() -> list[str]:
    """Return a line for each difference between the product and ``kinds.toml``."""
    out = []
    for kind, reasons in read_reasons().items():
        found = find_places(kind)
        out += [
            f"{kind}: {p.path}:{p.line} {p.name} is not in docs/kinds.toml"
            for key, p in found.items()
            if key not in reasons
        ]
        out += [
            f"{kind}: {key} of docs/kinds.toml is gone" for key in reasons if key not in found and not find_by_name(key)
        ]
    return out


def is_counted(reason: str) -> bool:
    """Return whether a place with this reason counts as one of its kind."""
    return not reason.startswith((*APART, OTHER))


def count_places() -> dict[str, tuple[int, int, int]]:
    """Return by kind the number of places that count, of those to be merged, and of those separate on purpose."""
    return {
        kind: (
            sum(map(is_counted, reasons.values())),
            sum(not r for r in reasons.values()),
            sum(r.startswith(APART) for r in reasons.values()),
        )
        for kind, reasons in read_reasons().items()
    }


def describe() -> Iterator[str]:
    """Yield the counts as a table, then every place with its line and reason, by kind."""
    yield "| kind | places | of these to be merged | separate on purpose |"
    yield "|---|---|---|---|"
    for kind, counts in count_places().items():
        yield f"| {kind} | {' | '.join(map(str, counts))} |"
    for kind, reasons in read_reasons().items():
        yield f"\n## {kind}\n\n{(FINDERS[kind].__doc__ or '').splitlines()[0]}\n"
        found = find_places(kind)
        for key, reason in reasons.items():
            if place := found.get(key) or find_by_name(key):
                yield f"- {place.path}:{place.line} {place.name}: {reason or 'TO BE MERGED'}"


def list_new() -> Iterator[str]:
    """Yield the tables of lines that ``kinds.toml`` lacks."""
    for kind, reasons in read_reasons().items():
        if new := [key for key in find_places(kind) if key not in reasons]:
            yield "\n".join((f'["{kind}"]', *(f'"{key}" = ""' for key in new), ""))


def main(arguments: list[str]) -> int:
    """Print the list, or with --new the missing lines; return 1 if ``kinds.toml`` and the product differ, else 0."""
    faults = list_faults()
    sys.stdout.write("\n".join((*(list_new() if "--new" in arguments else describe()), "")))
    sys.stderr.write("\n".join((*faults, "") if faults else ()))
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
