"""Everything that runs is installed: packages, the wheel and its files, locks; workflows call what there is."""

import os
import re
import subprocess
import sys
import tomllib
import zipfile
import zlib
from pathlib import Path

import pytest

from mbsbench.harness.catalogue import codes
from mbsbench.harness.results.environment import ROOT

SETUPTOOLS = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["setuptools"]
LARGEST = 3_000_000  # [bytes]: every row of every claim is in it
PARTS = ("cli", "harness", "problems", "solvers", "reports")


def test_every_folder_with_modules_is_a_package():
    """Packages are found by their ``__init__.py``: a folder without it would be missing once installed."""
    folders = {path.parent for part in PARTS for path in (ROOT / part).rglob("*.py")}
    assert all((folder / "__init__.py").is_file() for folder in folders)


def test_every_data_file_is_named():
    """Files beside modules in the packages, and those that the harness reads below results/."""
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
    left_out = {f for patterns in SETUPTOOLS["exclude-package-data"].values() for p in patterns for f in ROOT.glob(p)}
    return [f for f in [*files, ROOT / "locks" / "requirements.lock"] if f.exists() and f not in left_out]


def test_the_checker_is_in_the_wheel():
    """Without it no ladder can be ranked; it is data, since nothing imports it."""
    assert "checker/check_bundle.py" in SETUPTOOLS["package-data"]["mbsbench"]
    assert (ROOT / "checker" / "check_bundle.py").is_file()


def test_the_wheel_stays_below_3_MB():
    """Modules and data, compressed as in a wheel; its own files add a few percent, which the slow test counts."""
    files = [*_data(), *(p for part in PARTS for p in (ROOT / part).rglob("*.py"))]
    assert sum(len(zlib.compress(f.read_bytes())) for f in files) < 0.95 * LARGEST


@pytest.mark.slow
def test_wheel_carries_modules_and_data(tmp_path):
    """Built from a copy of what is committed or about to be; the same files shape results there as here."""
    listed = subprocess.run(
        ("git", "ls-files", "--cached", "--others", "--exclude-standard"),
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    if listed.returncode:
        pytest.skip("needs git and a checkout")
    for name in listed.stdout.splitlines():
        if (ROOT / name).is_file():
            (tmp_path / "src" / name).parent.mkdir(parents=True, exist_ok=True)
            (tmp_path / "src" / name).write_bytes((ROOT / name).read_bytes())
    pip = (sys.executable, "-m", "pip", "wheel", ".", "--no-deps", "--no-build-isolation", "--quiet", "-w", "..")
    subprocess.run(pip, cwd=tmp_path / "src", check=True, capture_output=True)
    (wheel,) = tmp_path.glob("*.whl")
    modules = [
        ROOT / "__init__.py",
        ROOT / "__main__.py",
        ROOT / "api.py",
        ROOT / "kit.py",
        ROOT / "notebook.py",
        ROOT / "checker" / "check_bundle.py",
        *(p for part in PARTS for p in (ROOT / part).rglob("*.py")),
    ]
    assert wheel.stat().st_size < LARGEST
    with zipfile.ZipFile(wheel) as file:
        inside = set(file.namelist())
        file.extractall(tmp_path / "installed")
    wanted = {f"mbsbench/{f.relative_to(ROOT).as_posix()}" for f in [*modules, *_data()]}
    assert wanted - inside == set()
    assert not {n for n in inside - wanted if not n.split("/")[0].endswith(".dist-info")}
    code = (
        "from mbsbench.harness.catalogue.codes import digest_code\n"
        "from mbsbench.harness.results.environment import read_commit\n"
        "print(digest_code(), read_commit() or 'no commit')"
    )
    installed = subprocess.run(
        (sys.executable, "-c", code),
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(tmp_path / "installed")},
        check=True,
        capture_output=True,
        text=True,
    )
    assert installed.stdout.strip() == f"{codes.digest_code()} no commit"


def test_locks_carry_hashes_and_agree():
    """Each package of each lock is one of known files; what two of one environment name has one version."""
    known: dict[str, set[str]] = {}
    for path in sorted((ROOT / "locks").glob("requirements*.lock")):
        own: dict[str, set[str]] = {}
        for pin in re.split(r"\n(?=[A-Za-z0-9])", path.read_text(encoding="utf-8")):
            first, *rest = pin.splitlines()
            name, version = first.split("==", 1)
            hashes = [line.strip(" \\") for line in rest if "--hash" in line]
            assert hashes, f"{path.name}: {first}"
            assert all(re.fullmatch("--hash=sha256:[0-9a-f]{64}", h) for h in hashes), f"{path.name}: {first}"
            assert re.fullmatch(r"\d+(\.\d+)*((a|b|rc)\d+)?(\.post\d+)?", version.split()[0]), f"{path.name}: {first}"
            own.setdefault(name, set()).add(version.split()[0])  # without the platforms it is for
        if path.name.startswith("requirements-engines-"):  # of an environment of its own
            continue
        assert len(own) > 20
        assert {n: v for n, v in own.items() if known.get(n, v) != v} == {}
        known |= own


WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
TARGETS = set(re.findall(r"^([a-z][a-z-]*):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))


@pytest.mark.parametrize("path", [*WORKFLOWS, ROOT / ".ci" / "run"], ids=lambda p: p.name)
def test_called_targets_are_in_the_makefile(path):
    text = path.read_text(encoding="utf-8")
    called = set(re.findall(r"(?<![\w-])make ([a-z][a-z-]*)", text))
    for words in re.findall(r"^test_part (.*)", text, re.MULTILINE):
        called |= {word for word in words.split() if "=" not in word}
    assert called
    assert called <= TARGETS


def test_the_workflow_of_the_wheel_has_the_same_limit():
    (limit,) = re.findall(r"-lt (\d+)", (ROOT / ".github" / "workflows" / "wheel.yml").read_text(encoding="utf-8"))
    assert int(limit) == LARGEST


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda p: p.name)
def test_a_workflow_is_valid(path):
    """Each job has a machine and steps; each step runs a command or uses an action of a stated version."""
    yaml = pytest.importorskip("yaml", reason="PyYAML comes with `make docs`")
    plain = yaml.safe_load(path.read_text(encoding="utf-8"))
    assert plain["name"] == path.stem
    assert plain[True] == ["push", "pull_request"]  # YAML 1.1 reads the key `on` as true
    for job in plain["jobs"].values():
        assert job["runs-on"] == "ubuntu-latest"
        for step in job["steps"]:
            assert ("run" in step) != ("uses" in step)
            assert re.fullmatch(r"[\w-]+/[\w-]+@v\d+", step.get("uses", "a/b@v1"))
