"""Names that a stranger understands: verb and object for functions, nouns of the field for classes.

A participle, an adverb or a preposition alone names nothing; a name that another file imports says more than a letter.
"""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PRODUCT = ("harness", "solvers", "problems", "reports", "cli")
PRIVATE = """
    about across ahead alone along apart around away back because begun beneath beside beyond broad carried distinct
    done due enough fair followed given guess half held here home judged kept least lent look looked lost made
    matter merged misleads moved near nearby nobody now of off old one other over owed own passed pick plain pure push
    pushed reach reached recorded refused said same scored sealed sent settle settled shown shut_in shut_out small
    smaller simpler some still stretch taken tell tell_apart there through thrown told told_apart together
    turned unless until unwound way what where whole why wide width within without worn
    """
STAYS = {  # names that others call, and names of data: why each is as it is
    "harness/mechanics/types/problem.py home": "the home frame of a problem: a method that plug-ins call",
    "harness/mechanics/state.py one": "a method of States, which plug-ins call",
    "harness/mechanics/joints/frames.py across": "a direction of a joint's frame, as declarations read it",
    "harness/mechanics/forces/load.py push": "the equation of a declared force",
    "harness/mechanics/forces/spring.py push": "the equation of a declared force",
    "harness/mechanics/forces/torsion.py push": "the equation of a declared force",
    "solvers/formulations/compiled/evaluation.py push": "a compiled entry, after the equation of a force",
    "solvers/formulations/compiled/host.py stretch": "the same method of all marchers: to be renamed together",
    "solvers/formulations/joint_coordinates/relay.py stretch": "the same method of all marchers",
    "solvers/formulations/methods/gc_weak_form.py stretch": "the same method of all marchers",
    "harness/mechanics/types/solver.py due": "part of the contract of solvers",
    "harness/run/spool.py due": "part of the contract of solvers, in a file",
    "harness/run/progress_line.py due": "part of the contract of solvers, for a line of progress",
    "harness/run/presenting.py due": "part of the contract of solvers, for a presented problem",
    "harness/judge/referee/claims/metrics.py away": "a measure's name in claims.toml",
    "harness/judge/referee/claims/metrics.py apart": "a measure's name in claims.toml",
    "harness/judge/referee/claims/metrics.py reached": "a measure's name in claims.toml",
    "reports/model/accuracy.py of": "read by templates of pages",
}
SHORT = {  # of three letters or fewer, imported by other files
    "so3": "the rotation group", "exp": "the paper's", "hat": "the paper's", "log": "the paper's",
    "dot": "the scalar product", "gap": "a joint's phi at a point", "rhs": "the right-hand side of a state equation",
    "Run": "a run", "Job": "a run as a process gets it", "Law": "a law that is checked", "Fit": "a fitted line",
    "Ida": "the solver's name", "ida": "the solver's name", "Jet": "a truncated power series", "jet": "the same",
    "Row": "a row of constraints", "Rod": "a rigid bar", "Box": "a box around points", "Vec": "a vector in space",
    "run": "runs a compiled entry, or a run", "put": "sets numbers of a compiled array", "gbs": "Gragg-Bulirsch-Stoer",
    "npz": "the format", "fmu": "the format", "usd": "the format", "api": "the public module", "kit": "the module",
    "OZ": "an axis", "NAN": "not a number", "END": "the end of a motion", "INK": "a colour", "FEW": "a number of spans",
    "MAP": "the kind of a file", "GAP": "a distance between steps", "ONE": "the constant function",
    "OUT": "a file's name",
    "WHY": "a file's name", "C": "the table of spans", "S": "the table of spans", "X": "an axis",
}  # fmt: skip


def list_files() -> list[Path]:
    """Return the files of the product's rooms."""
    return [p for room in PRODUCT for p in sorted((ROOT / room).rglob("*.py"))]


def list_definitions(path: Path) -> Iterator[tuple[str, ast.AST]]:
    """Yield functions of the module, its classes and their methods; those inside a function are its own affair."""
    waiting: list[ast.AST] = [ast.parse(path.read_text(encoding="utf-8"))]
    while waiting:
        for node in ast.iter_child_nodes(waiting.pop()):
            if isinstance(node, ast.ClassDef):
                waiting.append(node)
            if isinstance(node, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
                yield node.name, node


def is_data(node: ast.AST) -> bool:
    """Return whether a definition is read like data or replaces one of a base class."""
    return any("property" in ast.unparse(d) for d in getattr(node, "decorator_list", ()))


def test_no_function_or_class_has_a_private_word_as_its_name() -> None:
    """A reader of a call must see what is done, to what."""
    found = [
        f"{place} {name}"
        for path in list_files()
        for name, node in list_definitions(path)
        if name.lower() in PRIVATE.split() and not is_data(node)  # _names are their own file's affair
        if f"{(place := path.relative_to(ROOT).as_posix())} {name}" not in STAYS
    ]
    assert not found, "\n".join(found)


def test_names_that_cross_a_file_are_words() -> None:
    """A name of three letters is one of mathematics or of the glossary, or it is spelled out."""
    found = {
        f"{path.relative_to(ROOT).as_posix()}: {alias.name}"
        for path in list_files()
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.ImportFrom) and node.level
        for alias in node.names
        if len(alias.name) < 4 and alias.name not in SHORT and alias.name != "*"
    }
    assert not found, "\n".join(sorted(found))


@pytest.mark.parametrize("entry", STAYS)
def test_what_stays_is_there(entry: str) -> None:
    """An exception without its name is out of date."""
    file, name = entry.split()
    assert name in {n for n, _ in list_definitions(ROOT / file)}, entry
