"""Imports inside the package are relative: absolute ones find it only where its folder is called ``mbsbench``.

Contracts in pyproject.toml hold who imports whom; those that a string names, which they do not see, are held here.
"""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
ROOMS = ("cli", "harness", "problems", "reports", "solvers")
EXAMPLES = sorted((ROOT / "docs" / "examples").glob("*.py"))


def list_absolute_imports(text: str) -> list[str]:
    """Return the names in ``mbsbench`` that a module imports absolutely; what a string holds is no import."""
    found = []
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            found += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and not node.level:
            found.append(node.module or "")
    return [name for name in found if name.partition(".")[0] == "mbsbench"]


def test_imports_inside_the_package_are_relative() -> None:
    """The modules beside the rooms, such as ``api.py``, too; ``setup.py`` is no module of the package."""
    files = [p for p in ROOT.glob("*.py") if p.name != "setup.py"]
    files += [p for room in ROOMS for p in sorted((ROOT / room).rglob("*.py"))]
    found = {p.relative_to(ROOT).as_posix(): list_absolute_imports(p.read_text(encoding="utf-8")) for p in files}
    assert len(found) > 500 and not {place: names for place, names in found.items() if names}


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda p: p.name)
def test_plug_ins_import_from_the_package_itself(path: Path) -> None:
    """Those that the pages show; all but the names of ``mbsbench/__init__.py`` may change."""
    assert set(list_absolute_imports(path.read_text(encoding="utf-8"))) <= {"mbsbench"}


def test_each_form_of_an_import_is_seen() -> None:
    """Those inside functions, too; a relative one and another package are none of ours."""
    text = "import mbsbench.api\ndef f():\n    from mbsbench.harness import files\nfrom . import x\nimport mbsbenches\n"
    assert list_absolute_imports(f"{text}s = 'import mbsbench'\n") == ["mbsbench.api", "mbsbench.harness"]


BY_NAME = {  # what rooms import by name, and why an import would not do
    "harness/catalogue/mechanism.py": "readers of files, which a copy may lack",
    "harness/catalogue/registry.py": "the catalogues: a file of problems/ or solvers/ by the name of its entry",
    "harness/formats/mechanisms/mechanism_files.py": "a package",
    "harness/formats/mechanisms/sympy_systems.py": "a package",
    "harness/formats/mechanisms/usd.py": "a package",
    "harness/formats/motions/fmu.py": "a package",
    "harness/mechanics/joints/__init__.py": "the kinds of joints, a file each in a folder of its own",
    "harness/reference/computation.py": "a closed form, which belongs to the problems",
}


def list_imports_by_name(text: str) -> list[str]:
    """Return the arguments of calls of ``import_module`` in a module, as text."""
    calls = [node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Call)]
    return [ast.unparse(c.args[0]) for c in calls if ast.unparse(c.func).endswith(("import_module", "__import__"))]


def test_imports_by_name_are_few_and_none_is_of_a_solver() -> None:
    """In the harness, where a contract forbids to import one; the catalogue alone finds them, by folder."""
    files = sorted((ROOT / "harness").rglob("*.py"))
    found = {p.relative_to(ROOT).as_posix(): list_imports_by_name(p.read_text(encoding="utf-8")) for p in files}
    found = {place: names for place, names in found.items() if names}
    assert {*found} <= {*BY_NAME}, "say in BY_NAME why it is imported by name"
    assert not [name for names in found.values() for name in names if "solvers" in name]
    assert list_imports_by_name("importlib.import_module(f'...solvers.{x}', p)") == ["f'...solvers.{x}'"]


LOADED = """
import pkgutil, sys, importlib
import mbsbench.harness as harness
names = [m.name for m in pkgutil.walk_packages(harness.__path__, "mbsbench.harness.")]
for name in names:
    importlib.import_module(name)
print(len(names), *(n for n in sys.modules if n.startswith("mbsbench.solvers")))
"""


def test_the_harness_loads_without_any_solver() -> None:
    """All its modules, in a process of their own: what they need of solvers comes by the catalogue when they run."""
    done = subprocess.run([sys.executable, "-c", LOADED], capture_output=True, text=True, check=True)
    number, *solvers = done.stdout.split()
    assert int(number) > 150 and not solvers
