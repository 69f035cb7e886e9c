"""Describe solvers and problems by the first sentences of their files and by the traits a problem tests."""

import ast
import re
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
TRAITS = {  # why a problem with this trait is hard
    "chaotic": "Small errors grow exponentially: beyond some time no computed motion is the exact one.",
    "singular": "The constraint matrix loses rank at instants, where the motion could branch.",
    "redundant": "There are more constraint rows than their rank, so that reactions are not unique.",
    "stiff": "Its fastest time constants lie far below those of the motion that is asked for.",
    "long": "Hundreds of turns let any systematic error in energy or phase add up.",
    "damped": "Dampers take energy out, and a scheme that damps by itself goes unnoticed.",
    "driven": "A drive does work, which the energy balance has to account for.",
    "nonholonomic": "Some constraints act on velocities alone, and no position can be projected onto them.",
}
PLAIN = "No trait makes it hard: what counts is the error at a given cost."


def describe_method(name: str) -> str:
    """Describe a solver's method by the first lines of the docstrings of file and class; empty for a plug-in."""
    path = next((p for p in (f"solvers/{name}.py", f"solvers/engines/{name}.py") if _read_source(p)), "")
    if not path:
        return ""
    whole = ast.parse(_read_source(path))
    classes = [n for n in whole.body if isinstance(n, ast.ClassDef) and n.decorator_list]
    named = [n for n in classes if any(repr(name) in ast.unparse(d) for d in n.decorator_list)]
    return " ".join(filter(None, dict.fromkeys([_read_summary(whole), *(_read_summary(n) for n in named[:1])])))


def is_engine(name: str) -> bool:
    """Return whether a solver runs an external engine."""
    return bool(_read_source(f"solvers/engines/{name}.py"))


def name_external_code(name: str) -> str:
    """Return the usual name of the external package that a solver runs; empty if all its code is this project's."""
    name_of_it = re.split(r"[,:.]", describe_method(name))[0]
    return name_of_it if is_engine(name) or name_of_it.startswith("SUNDIALS") else ""


def describe_mechanism(name: str) -> str:
    """Describe a mechanism by the first line of the docstring of its file; empty for a plug-in."""
    source = _read_source(f"problems/{name}.py")
    return _read_summary(ast.parse(source)) if source else ""


def explain_difficulty(name: str) -> str:
    """Explain why a problem is hard, a sentence for each of its first two traits; empty for a plug-in."""
    source = _read_source(f"problems/{name}.py")
    traits = re.findall(r"Trait\.(\w+)", source.partition("@problem(")[2].partition("\n")[0])
    known = [TRAITS[t.lower()] for t in traits if t.lower() in TRAITS]
    return " ".join(known[:2]) or (PLAIN if source else "")


def _read_summary(node: ast.Module | ast.ClassDef) -> str:
    """Return the first line of the docstring of a module or class."""
    return (ast.get_docstring(node) or "").partition("\n")[0].replace("``", "")


@cache
def _read_source(path: str) -> str:
    """Return the text of a file of this package, such as ``solvers/rattle.py``; empty if there is none."""
    if not re.fullmatch(r"[\w/]+\.py", path) or not (ROOT / path).is_file():
        return ""
    return (ROOT / path).read_text(encoding="utf-8")
