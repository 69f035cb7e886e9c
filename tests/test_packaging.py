"""What is installed is what runs: every folder is a package, and a wheel carries every file that is read."""

import os
import re
import subprocess
import sys
import tomllib
import zipfile
import zlib
from pathlib import Path

import pytest

from mbsbench.harness.results import environment

ROOT = Path(__file__).resolve().parents[1]
SETUPTOOLS = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["setuptools"]
LARGEST = 2_000_000  # bytes of a wheel
PARTS = ("cli", "harness", "problems", "solvers", "reports")


def test_every_folder_with_modules_is_a_package():
    """Packages are found by their ``__init__.py``: a folder without it would be missing once installed."""
    folders = {path.parent for part in PARTS for path in (ROOT / part).rglob("*.py")}
    assert all((folder / "__init__.py").is_file() for folder in folders)


def test_every_data_file_is_named():
    """What is in the repository beside modules in the packages, and what the harness reads below results/."""
    package_data = {
        file
        for package, patterns in SETUPTOOLS["package-data"].items()
        for pattern in patterns
        for file in ROOT.joinpath(*package.split(".")[1:]).glob(pattern)
    }
    assert {f for f in _data() if f not in package_data} == set()


def _data() -> list[Path]:
    git = subprocess.run(("git", "ls-files", *PARTS, "results"), cwd=ROOT, capture_output=True, text=True, check=False)
    if git.returncode:
        pytest.skip("needs git and a checkout")
    files = [ROOT / line for line in git.stdout.splitlines() if not line.endswith(".py")]
    left_out = {ROOT / f for files in SETUPTOOLS["exclude-package-data"].values() for f in files}
    return [f for f in [*files, ROOT / "requirements.lock"] if f.exists() and f not in left_out]


def test_the_wheel_stays_below_2_MB():
    """Modules and data, compressed as in a wheel; its own files add a few percent, which the slow test counts."""
    files = [*_data(), *(p for part in PARTS for p in (ROOT / part).rglob("*.py"))]
    assert sum(len(zlib.compress(f.read_bytes())) for f in files) < 0.95 * LARGEST


@pytest.mark.slow
def test_wheel_carries_modules_and_data(tmp_path):
    """Built from a copy of what is committed or about to be; the same files shape results there as here."""
    listed = subprocess.run(
        ("git", "ls-files", "--cached", "--others", "--exclude-standard"), cwd=ROOT, capture_output=True, text=True,
        check=False,
    )  # fmt: skip
    if listed.returncode:
        pytest.skip("needs git and a checkout")
    for name in listed.stdout.splitlines():
        if (ROOT / name).is_file():
            (tmp_path / "src" / name).parent.mkdir(parents=True, exist_ok=True)
            (tmp_path / "src" / name).write_bytes((ROOT / name).read_bytes())
    pip = (sys.executable, "-m", "pip", "wheel", ".", "--no-deps", "--no-build-isolation", "--quiet", "-w", "..")
    subprocess.run(pip, cwd=tmp_path / "src", check=True, capture_output=True)
    (wheel,) = tmp_path.glob("*.whl")
    modules = [ROOT / "__init__.py", ROOT / "api.py", *(p for part in PARTS for p in (ROOT / part).rglob("*.py"))]
    assert wheel.stat().st_size < LARGEST
    with zipfile.ZipFile(wheel) as file:
        inside = set(file.namelist())
        file.extractall(tmp_path / "installed")
    wanted = {f"mbsbench/{f.relative_to(ROOT).as_posix()}" for f in [*modules, *_data()]}
    assert wanted - inside == set()
    assert not {n for n in inside - wanted if not n.split("/")[0].endswith(".dist-info")}
    code = "import mbsbench.harness.results.environment as e; print(e.code_digest(), e.commit() or 'no commit')"
    installed = subprocess.run(
        (sys.executable, "-c", code), cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(tmp_path / "installed")},
        check=True, capture_output=True, text=True,
    )  # fmt: skip
    assert installed.stdout.strip() == f"{environment.code_digest()} no commit"


def test_locks_carry_hashes_and_agree():
    """Each package of each lock is one of known files; what two of them name has the same versions in both."""
    known: dict[str, set[str]] = {}
    for path in sorted(ROOT.glob("requirements*.lock")):
        own: dict[str, set[str]] = {}
        for pin in re.split(r"\n(?=[A-Za-z0-9])", path.read_text(encoding="utf-8")):
            first, *rest = pin.splitlines()
            name, version = first.split("==", 1)
            assert any("--hash=sha256:" in line for line in rest), f"{path.name}: {first}"
            own.setdefault(name, set()).add(version.split()[0])  # without the platforms it is for
        assert len(own) > 20
        assert {n: v for n, v in own.items() if known.get(n, v) != v} == {}
        known |= own
