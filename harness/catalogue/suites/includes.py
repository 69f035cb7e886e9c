"""Collect the files behind a suite, each once, included files before those that include them."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ...base.files import FileError, parse_toml, read_text
from ...base.hints import suggest_name
from ...base.shapes import convert_shape
from .shape import SuiteFile

FOLDER = Path(__file__).parent
OWN_COPY = "suite"  # name of the suite's own copy in a results folder


@dataclass(frozen=True)
class SuiteSource:
    """A suite file, read but not expanded."""

    name: str  # name of the file, without .toml
    where: str  # names it in messages
    text: str
    file: SuiteFile
    beside: Path  # plugins and included suites are looked for here


def list_suites() -> list[str]:
    """Return the names of the suites in ``harness/catalogue/suites/``."""
    return sorted(p.stem for p in FOLDER.glob("*.toml"))


def find_suite_file(name: str, beside: Path | None = None) -> Path:
    """Return the file of a suite given by name or path; raise FileError, with a similar name, if a name is unknown.

    ``beside`` is the folder of the suite that includes it. A path is returned whether or not the file exists.
    """
    if name.endswith(".toml") or "/" in name:
        return (beside or Path()) / name
    folders = [FOLDER] if beside is None else [beside, FOLDER]
    found = [path for path in (folder / f"{name}.toml" for folder in folders) if _is_file(path)]
    if not found:
        known = sorted({p.stem for folder in folders for p in folder.glob("*.toml")})
        raise FileError(f"unknown suite {name!r}{suggest_name(name, known)}")
    return found[0]


def _is_file(path: Path) -> bool:
    """Return whether there is a file at a path; False for a path that no file can have."""
    try:
        return path.is_file()
    except (OSError, ValueError):  # a name too long, or of characters no file can have
        return False


def read_source(path: Path) -> SuiteSource:
    """Read the file at ``path``; raise FileError if it is invalid."""
    return make_source(read_text(path, "suite"), path.stem, str(path), path.parent)


def make_source(text: str, name: str, where: str, beside: Path = Path()) -> SuiteSource:
    """Return the suite file in ``text``, not expanded; raise FileError if it is invalid.

    ``where`` names it in messages; plugins and includes are looked for ``beside`` it.
    """
    return SuiteSource(name, where, text, convert_shape(parse_toml(text, where), SuiteFile, where), beside)


def list_included(first: SuiteSource) -> list[SuiteSource]:
    """Return all files that ``first`` includes, directly or not, each once and after its own includes, and ``first``.

    Raise FileError if they include each other in a circle, or if two have the same name.
    """
    found: dict[Path, SuiteSource] = {}
    _collect_includes(first, _resolve_place(first), (), found)
    names: dict[str, str] = {OWN_COPY: "its own copy in the results folder"}
    for s in list(found.values())[:-1]:  # copies are written into one folder, where names must be unique
        if s.name in names:
            raise FileError(f"{first.where}: {s.where} and {names[s.name]} have the same name: rename one")
        names[s.name] = s.where
    return list(found.values())


def _collect_includes(
    s: SuiteSource, place: Path, above: Sequence[tuple[Path, str]], found: dict[Path, SuiteSource]
) -> None:
    """Add the suite file ``s``, whose path is ``place``, to ``found`` after all that it includes.

    ``above`` has path and name of each file on the way that includes it. Raise FileError if it includes one of these.
    """
    chain = [*above, (place, s.name)]
    for name in s.file.include:
        try:
            path = find_suite_file(name, s.beside)
        except FileError as error:
            raise FileError(f"{s.where}: include: {error}") from None
        target = path.resolve()
        if target in dict(chain):
            circle = " includes ".join([*(n for _, n in chain), path.stem])
            raise FileError(f"{s.where}: suites include each other in a circle: {circle}")
        if target not in found:
            _collect_includes(read_source(path), target, chain, found)
    found[place] = s


def _resolve_place(s: SuiteSource) -> Path:
    """Return the absolute path of a suite file; a suite that exists only as text gets a path made from its name."""
    path = Path(s.where)
    return path.resolve() if path.suffix == ".toml" else Path(f"/{s.where}")
