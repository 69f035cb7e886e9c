"""Runs have the same bits whatever the processor offers and whatever is preset; --native leaves both as they are."""

import json
import os
import platform
import subprocess
import sys

import pytest

from mbsbench.harness import machine
from mbsbench.harness.results import provenance
from mbsbench.harness.results.environment import ROOT

pytestmark = pytest.mark.skipif(not machine.variables(), reason="this processor is none that the pin knows")
SHAPING = (
    machine.NATIVE, machine.ENABLED, "OPENBLAS_CORETYPE", "NPY_DISABLE_CPU_FEATURES", "NUMBA_CPU_NAME",
    "NUMBA_CPU_FEATURES", "GLIBC_TUNABLES",
)  # fmt: skip
DESCRIBE = """
import json, mbsbench
from mbsbench.harness.results import environment
made = environment.stamp("", "", 1, ())
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


def run(program: str, *first: str, **preset: str) -> subprocess.CompletedProcess[str]:
    """Run a program in a process with nothing but ``preset`` of the variables that shape arithmetic."""
    bare = {k: v for k, v in os.environ.items() if k not in SHAPING}
    words = (sys.executable, *first, "-c", program)
    return subprocess.run(words, cwd=ROOT, env={**bare, **preset}, capture_output=True, text=True, check=True)


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
    pinned, simd, llvm, kernels = json.loads(run(DESCRIBE, **preset).stdout)
    target = machine.TARGETS[platform.machine()]
    assert pinned and set(simd) <= target.loops and llvm == target.compiled
    assert set(kernels) == {target.kernels}


def test_native_leaves_what_is_there():
    """Who wants the last per cent, or to see what another kernel does, gets what the environment says."""
    pinned, _, llvm, kernels = json.loads(run(DESCRIBE, MBSBENCH_NATIVE="1", OPENBLAS_CORETYPE="Sandybridge").stdout)
    assert not pinned and "Sandybridge" in kernels and llvm != ""


def test_motions_have_the_same_bits_whatever_is_preset():
    """Four roads to a solution: our own arithmetic, LAPACK, SciPy, SUNDIALS; --native shows that they can differ."""
    here = run(SOLVE).stdout
    assert len(here.split()) == 4
    for kernels in ("Zen", "Sandybridge"):
        assert run(SOLVE, OPENBLAS_CORETYPE=kernels, NPY_DISABLE_CPU_FEATURES="X86_V3").stdout == here
    native = run(SOLVE, MBSBENCH_NATIVE="1", OPENBLAS_CORETYPE="Sandybridge").stdout.split()
    assert native[0] == here.split()[0]
    assert native != here.split()


def test_a_notebook_that_loaded_numpy_first_is_told_so_in_one_line():
    """Too late for the pin: the line says what is in force and what to do, once; in the right order there is none."""
    solves = "for _ in range(2): mbsbench.solve('heavy_top', 'rattle', t_end=0.01, dt=1e-3)\n"
    late = run(f"import numpy.linalg, mbsbench\n{solves}", OPENBLAS_CORETYPE="Sandybridge").stderr
    assert late.count("UserWarning") == 1 and "import mbsbench before numpy" in late and "Sandybridge" in late
    assert "UserWarning" not in run(f"import mbsbench, numpy\n{solves}").stderr


def test_kernels_are_a_cause_of_different_digits():
    """Two runs of one commit on two machines differ: "no input differs: a solver is not deterministic" was false."""
    one = {"cpu": "A", "blas": [{"internal_api": "openblas", "architecture": "Haswell"}], "pinned": True}
    other = {**one, "blas": [{"internal_api": "openblas", "architecture": "SkylakeX"}], "pinned": False}
    assert not provenance.same_platform(one, other)
    words = provenance.describe_differences(provenance.find_differences(one, other))
    assert "kernels" in words and "SkylakeX" in words
    assert provenance.same_platform(one, {**one, "cpu": "B"})
    assert not provenance.same_platform(other, {**other, "cpu": "B"})
    assert [provenance.describe_processor(s) for s in (one, other)] == ["A", "A (SkylakeX kernels)"]


def test_numpy_is_not_asked_to_do_without_what_it_does_not_know():
    """It would warn of it, which is an error where warnings are."""
    run("import mbsbench, numpy", "-W", "error")


def test_names_do_not_depend_on_the_processor():
    """One that is emulated, or another of a cluster with the same files, may ask first, and has fewer features."""
    wanted = "import numpy; s = numpy.show_config('dicts')['SIMD Extensions']; print(*s['found'], *s['not found'])"
    names = set(run(wanted).stdout.split()) - machine.TARGETS[platform.machine()].loops
    assert set(machine.variables()["NPY_DISABLE_CPU_FEATURES"].split()) == names


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="another C library")
def test_another_choice_of_the_c_library_is_named():
    """It reads its own variable before anything of ours runs: that cannot be pinned, and sines are then other ones."""
    pinned, *_ = json.loads(run(DESCRIBE, GLIBC_TUNABLES="glibc.cpu.hwcaps=-AVX2,-FMA").stdout)
    assert not pinned
