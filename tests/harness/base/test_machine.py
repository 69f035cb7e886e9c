"""Runs have the same bits whatever the processor offers and whatever is preset; --native leaves both as they are."""

import json
import os
import platform
import subprocess
import sys

import pytest
from llvmlite import binding

from mbsbench.cli.progress import warn_of_deviating_bits
from mbsbench.harness.base import machine
from mbsbench.harness.results import provenance
from mbsbench.harness.results.environment import ROOT
from mbsbench.tests.covering import every

pytestmark = pytest.mark.skipif(not machine.list_variables(), reason="this processor has no pinned arithmetic")
SHAPING = (
    machine.NATIVE,
    machine.CORE,
    machine.ENABLED,
    "PYTEST_ADDOPTS",
    "OPENBLAS_CORETYPE",
    "NPY_DISABLE_CPU_FEATURES",
    "NUMBA_CPU_NAME",
    "NUMBA_CPU_FEATURES",
    "GLIBC_TUNABLES",
)
DESCRIBE = """
import json, mbsbench
from mbsbench.harness.results import environment
from mbsbench.harness.run import origin
made = origin.describe_environment("", "", 1, ())
kernels = [b["architecture"] for b in made["blas"] if b["architecture"]]
print(json.dumps([made["pinned"], made["simd"], made["llvm"], kernels]))
"""
SOLVE = """
import hashlib, warnings
import mbsbench
def digest(problem, solver, **given):
    run = mbsbench.solve(problem, solver, **given)
    states = run.trajectory.states
    return hashlib.sha256(b"".join(a.tobytes() for a in (states.r, states.R, states.v, states.Omega))).hexdigest()[:16]
print(digest("heavy_top", "gc_weak_form", t_end=0.2, dt=1e-3))  # no BLAS in the loop: the same even without the pin
print(digest("four_bar_grid", "rk45_strong_form", t_end=0.1, rtol=1e-6))  # LAPACK in the loop
print(digest("spherical_pendulum", "radau_index1", t_end=0.2, rtol=1e-6))  # SciPy
print(digest("spherical_pendulum", "ida_index1", t_end=0.2, rtol=1e-6))  # SUNDIALS
"""


TINY = """name = "tiny"
[[runs]]
problem = "heavy_top"
parameters = { t_end = 0.01 }
solver = "rk45_strong_form"  # of which nothing is compiled for another processor
rtol = 1e-3
"""
LATE = """
import numba
numba.njit(lambda x: 2.0 * x)(1.0)
import json, os, mbsbench
from mbsbench.harness.base import machine
from mbsbench.harness.mechanics.kept_code import digest_callback
numba.njit(lambda x: 3.0 * x)(1.0)  # reads numba's variables again
own = numba.core.registry.cpu_target.target_context.codegen().magic_tuple()[1]
print(json.dumps([machine.find_deviations(), machine.describe_machine()["llvm"], own, digest_callback(abs)]))
mbsbench.solve("heavy_top", "rattle", t_end=0.01, dt=1e-3)
"""


def run_unshaped(program: str, *first: str, **preset: str) -> subprocess.CompletedProcess[str]:
    """Run a program in a process with nothing but ``preset`` of the variables that shape arithmetic."""
    bare = {k: v for k, v in os.environ.items() if k not in SHAPING}
    words = (sys.executable, *first, "-c", program)
    return subprocess.run(words, cwd=ROOT, env={**bare, **preset}, capture_output=True, text=True, check=True)


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    "preset",
    [
        {},
        {"OPENBLAS_CORETYPE": "Sandybridge", "NUMBA_CPU_NAME": "generic"},
        {machine.ENABLED: "X86_V3"},  # beside the pin's list of what is disabled, NumPy would refuse to load
    ],
)
def test_what_is_preset_loses(preset):
    """A kernel that somebody's shell presets would decide the last digits of every motion."""
    pinned, simd, llvm, kernels = json.loads(run_unshaped(DESCRIBE, **preset).stdout)
    target = machine.TARGETS[platform.machine()]
    assert pinned and set(simd) <= target.loops and llvm == target.compiled
    assert set(kernels) == {target.kernels}


def test_native_leaves_what_is_there():
    """Who wants the last per cent, or to see what another kernel does, gets what the environment says."""
    pinned, _, llvm, kernels = json.loads(
        run_unshaped(DESCRIBE, MBSBENCH_NATIVE="1", OPENBLAS_CORETYPE="Sandybridge").stdout
    )
    assert not pinned and "Sandybridge" in kernels
    assert llvm == f"{binding.get_host_cpu_name()} {binding.get_host_cpu_features().flatten()}"


@pytest.mark.sampled(0)
@pytest.mark.parametrize("given", [("--native",), pytest.param((), marks=pytest.mark.slow)], ids=["native", "pinned"])
def test_the_option_of_a_command_reaches_its_runs(given, tmp_path):
    """It is looked for before NumPy is loaded; the record of the results says what was in force."""
    (tmp_path / "tiny.toml").write_text(TINY)
    words = ("run", str(tmp_path / "tiny.toml"), "--jobs", "1", "--out", str(tmp_path / "out"), *given)
    run_unshaped(f"from mbsbench.cli.__main__ import main; assert main({list(words)}) == 0")
    made = json.loads((tmp_path / "out" / "environment.json").read_text())
    assert made["pinned"] is (not given)
    assert (made["llvm"] == machine.TARGETS[platform.machine()].compiled) is (not given)


def test_the_option_is_not_for_a_cluster():
    """Its workers were started elsewhere, with an environment of their own."""
    call = "assert main(['run', 'ci', '--native', '--cluster', 'tcp://nowhere:1']) == 2"
    (line,) = run_unshaped(f"from mbsbench.cli.__main__ import main; {call}").stderr.splitlines()
    assert line.startswith("error: --native is for this machine") and "MBSBENCH_NATIVE=1" in line


@pytest.mark.parametrize("preset", ["--native", "-x --native", ""])
def test_tests_are_native_by_the_environment_of_pytest(preset):
    """Options that the variable gives are none of the command's."""
    program = "import os, mbsbench.tests.pinned; print(os.environ.get('MBSBENCH_NATIVE', ''))"
    assert run_unshaped(program, PYTEST_ADDOPTS=preset).stdout.strip() == ("1" if preset else "")


@pytest.fixture(scope="module")
def bits():
    """Of four motions, in the pinned arithmetic."""
    return run_unshaped(SOLVE).stdout


@pytest.mark.sampled(0)
@pytest.mark.parametrize("kernels", every(["Sandybridge", "Zen"], 2))
def test_motions_have_the_same_bits_whatever_is_preset(bits, kernels):
    """Four roads to a solution: our own arithmetic, LAPACK, SciPy, SUNDIALS."""
    assert len(bits.split()) == 4
    assert run_unshaped(SOLVE, OPENBLAS_CORETYPE=kernels, NPY_DISABLE_CPU_FEATURES="X86_V3").stdout == bits


@pytest.mark.sampled(0)
def test_native_motions_can_have_other_bits(bits):
    """Where BLAS is in the loop; our own arithmetic is the same."""
    native = run_unshaped(SOLVE, MBSBENCH_NATIVE="1", OPENBLAS_CORETYPE="Sandybridge").stdout.split()
    assert native[0] == bits.split()[0] and native != bits.split()


@pytest.mark.sampled(0)
def test_a_notebook_that_loaded_numpy_first_is_told_so_in_one_line():
    """Too late for the pin: the line says what is in force and what to do, once; in the right order there is none."""
    solves = "for _ in range(2): mbsbench.solve('heavy_top', 'rattle', t_end=0.01, dt=1e-3)\n"
    late = run_unshaped(f"import numpy.linalg, mbsbench\n{solves}", OPENBLAS_CORETYPE="Sandybridge").stderr
    assert late.count("UserWarning") == 1 and "import mbsbench before numpy" in late and "Sandybridge" in late
    assert "UserWarning" not in run_unshaped(f"import mbsbench, numpy\n{solves}").stderr


@pytest.mark.sampled(0)
def test_numba_that_was_loaded_first_is_not_taken_for_pinned():
    """It compiles on for this processor: said, recorded, in its own index, and in the key of code that we keep."""
    target, host = machine.TARGETS[platform.machine()].compiled, binding.get_host_cpu_name()
    done = run_unshaped(LATE, **{k: v for k, v in machine.list_variables().items() if not k.startswith("NUMBA")})
    late, llvm, own, key = json.loads(done.stdout)
    assert late == [f"numba compiles for {host}"] and llvm.startswith(f"{target}; numba: {host} ") and own == host
    assert done.stderr.count("UserWarning") == 1 and "import mbsbench before numpy and numba" in done.stderr
    early = run_unshaped(LATE.replace("import numba\n", "import mbsbench, numba\n"))
    assert json.loads(early.stdout)[:3] == [[], target, target] and json.loads(early.stdout)[3] != key
    assert early.stderr == "" and run_unshaped(LATE, **machine.list_variables()).stderr == ""


@pytest.mark.parametrize("damage", [lambda text: "", lambda text: text[:5], lambda text: text.split("\n")[0]])
def test_a_damaged_list_of_names_is_asked_for_again(damage, tmp_path):
    """Another process may be writing it, or a disk was full: nothing of NumPy would be pinned, without a word."""
    program = "import os, mbsbench; print(os.environ['NPY_DISABLE_CPU_FEATURES'])"
    fresh = run_unshaped(program, MBSBENCH_CACHE=str(tmp_path)).stdout
    (kept,) = (tmp_path / "machine").iterdir()
    text = kept.read_text()
    kept.write_text(damage(text))
    assert run_unshaped(program, MBSBENCH_CACHE=str(tmp_path)).stdout == fresh
    assert kept.read_text() == text and list(kept.parent.iterdir()) == [kept]


@pytest.mark.sampled(0)
def test_commands_announce_runs_with_bits_of_their_own(tmp_path):
    """Each that makes runs to be compared with others: one line on standard error."""
    (tmp_path / "tiny.toml").write_text(TINY)
    made = ["tiny.toml", "--jobs", "1", "--out", "out"]
    calls = (
        ["run", *made],
        ["verify", "out", "--jobs", "1"],
        ["gate", "--suite", "tiny.toml", "--thresholds", "new.toml", "--update", "--jobs", "1"],
    )
    program = f"import os; from mbsbench.cli.__main__ import main; os.chdir({str(tmp_path)!r})"
    done = run_unshaped(f"{program}; assert [main(c) for c in {calls!r}] == [0, 0, 0]", MBSBENCH_CORE="Sandybridge")
    lines = [x for x in done.stderr.splitlines() if "(OpenBLAS uses kernels of Sandybridge)" in x]
    assert len(lines) == len(calls)


def test_who_asked_for_native_runs_is_told_nothing(capsys, monkeypatch):
    """The line is for those who do not know."""
    monkeypatch.setattr(machine, "find_deviations", lambda: ["NumPy uses X86_V4"])
    monkeypatch.delenv(machine.NATIVE, raising=False)
    warn_of_deviating_bits()
    out, err = capsys.readouterr()
    assert out == "" and err.count("\n") == 1 and "NumPy uses X86_V4" in err
    monkeypatch.setenv(machine.NATIVE, "1")
    warn_of_deviating_bits()
    assert capsys.readouterr().err == ""


@pytest.mark.skipif(platform.machine() != "x86_64", reason="another architecture")
@pytest.mark.parametrize("flag", ["avx2", "bmi1", "bmi2", "f16c", "fma", "abm", "movbe"])
def test_a_processor_without_one_of_the_features_is_not_pinned(flag, monkeypatch):
    """Those of x86-64-v3, which LLVM may use for the common processor; lzcnt is Linux's abm."""
    without = machine.read_processor_flags() - {flag}
    monkeypatch.setattr(machine, "read_processor_flags", lambda: without)
    assert machine._find_target.__wrapped__() is None


def test_kernels_are_a_cause_of_different_digits():
    """Two runs of one commit on two machines differ: "no input differs: a solver is not deterministic" was false."""
    one = {"cpu": "A", "blas": [{"internal_api": "openblas", "architecture": "Haswell"}], "pinned": True}
    other = {**one, "blas": [{"internal_api": "openblas", "architecture": "SkylakeX"}], "pinned": False}
    assert not provenance.is_same_platform(one, other)
    words = provenance.describe_differences(provenance.find_differences(one, other))
    assert "kernels" in words and "SkylakeX" in words
    assert provenance.is_same_platform(one, {**one, "cpu": "B"})
    assert not provenance.is_same_platform(other, {**other, "cpu": "B"})
    assert [provenance.describe_processor(s) for s in (one, other)] == ["A", "A (SkylakeX kernels)"]


def test_numpy_is_not_asked_to_do_without_what_it_does_not_know():
    """It would warn of it, which is an error where warnings are."""
    run_unshaped("import mbsbench, numpy", "-W", "error")


def test_names_do_not_depend_on_the_processor(monkeypatch):
    """One that is emulated, or another of a cluster with the same files, may ask first, and has fewer features.

    Asked as a processor with AVX-512, which needs all names: one without it, as this may be, has none to disable. On
    one that has them all NumPy has no list of those not found.
    """
    flags = machine.read_processor_flags() | {"avx512f"}
    monkeypatch.setattr(machine, "read_processor_flags", lambda: flags)
    wanted = (
        "import numpy; s = numpy.show_config('dicts')['SIMD Extensions']; print(*s['found'], *s.get('not found', ()))"
    )
    names = set(run_unshaped(wanted).stdout.split()) - machine.TARGETS[platform.machine()].loops
    pinned = machine.list_variables.__wrapped__()  # not what this process keeps of its own processor
    assert names and set(pinned["NPY_DISABLE_CPU_FEATURES"].split()) == names


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="another C library")
def test_another_choice_of_the_c_library_is_named():
    """It reads its own variable before anything of ours runs: that cannot be pinned, and sines are then other ones."""
    pinned, *_ = json.loads(run_unshaped(DESCRIBE, GLIBC_TUNABLES="glibc.cpu.hwcaps=-AVX2,-FMA").stdout)
    assert not pinned
