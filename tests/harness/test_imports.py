"""Imports inside the package are relative: absolute ones find it only where its folder is called ``mbsbench``."""

import ast
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
