"""The files behind a suite, each once, the included before those that include them."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ..catalogue.options import nearest
from ..files import FileError, parse_toml, read_text
from ..shapes import convert_shape
from .shape import SuiteFile

FOLDER = Path(__file__).parent
OWN_COPY = "suite"  # what the copy of the suite itself is called in a results folder


@dataclass(frozen=True)
class Source:
    """One suite file, read but not expanded."""

    name: str  # of the file, without .toml
    where: str  # names it in messages
    text: str
    file: SuiteFile
    beside: Path  # plugins and included suites are looked for here


def suite_names() -> list[str]:
    """The suites of ``harness/suites/``."""
    return sorted(p.stem for p in FOLDER.glob("*.toml"))


def path_of(name: str, beside: Path | None = None) -> Path:
    """The file of a suite given by name or path; ``beside`` is the folder of the suite that includes it."""
    if name.endswith(".toml") or "/" in name:
        return (beside or Path()) / name
    folders = [FOLDER] if beside is None else [beside, FOLDER]
    found = [path for path in (folder / f"{name}.toml" for folder in folders) if _is_file(path)]
    if not found:
        known = sorted({p.stem for folder in folders for p in folder.glob("*.toml")})
        raise FileError(f"unknown suite {name!r}{nearest(name, known)}")
    return found[0]


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except (OSError, ValueError):  # a name too long, or of characters no file can have
        return False


def read_source(path: Path) -> Source:
    """The file at ``path``, or FileError."""
    return source(read_text(path, "suite"), path.stem, str(path), path.parent)


def source(text: str, name: str, where: str, beside: Path = Path()) -> Source:
    """The suite in ``text``."""
    return Source(name, where, text, convert_shape(parse_toml(text, where), SuiteFile, where), beside)


def with_included(first: Source) -> list[Source]:
    """``first`` behind all it includes, directly or not; each file once."""
    found: dict[Path, Source] = {}
    _follow(first, _place(first), (), found)
    names: dict[str, str] = {OWN_COPY: "its own copy in the results folder"}
    for s in list(found.values())[:-1]:  # copies go into one folder, and a name must mean one suite
        if s.name in names:
            raise FileError(f"{first.where}: {s.where} and {names[s.name]} have the same name: rename one")
        names[s.name] = s.where
    return list(found.values())


def _follow(s: Source, place: Path, above: Sequence[tuple[Path, str]], found: dict[Path, Source]) -> None:
    chain = [*above, (place, s.name)]
    for name in s.file.include:
        try:
            path = path_of(name, s.beside)
        except FileError as error:
            raise FileError(f"{s.where}: include: {error}") from None
        target = path.resolve()
        if target in dict(chain):
            circle = " includes ".join([*(n for _, n in chain), path.stem])
            raise FileError(f"{s.where}: include goes round in a circle: {circle}")
        if target not in found:
            _follow(read_source(path), target, chain, found)
    found[place] = s


def _place(s: Source) -> Path:
    path = Path(s.where)
    return path.resolve() if path.suffix == ".toml" else Path(f"/{s.where}")
