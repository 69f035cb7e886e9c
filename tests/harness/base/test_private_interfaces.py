"""What libraries do not publish is there in the installed versions, and the public way computes the same without it."""

from importlib import import_module
from importlib.metadata import version
from typing import Any, NamedTuple

import numpy as np
import pytest

from mbsbench import StepControl
from mbsbench.harness.base import private_interfaces
from mbsbench.harness.base.generated import code
from mbsbench.harness.catalogue.registry import make_problem, make_solver
from mbsbench.solvers.formulations import ida
from mbsbench.solvers.formulations.compiled import entries
from mbsbench.solvers.formulations.compiled.entries import BoundFunction

NUMBA, DAE, SUNDIALS = "numba", "scipy-dae", "scikit-sundae"
USED = [  # library, module, attribute
    (NUMBA, "numba.core.event", "Listener"),
    (NUMBA, "numba.core.event", "register"),
    (NUMBA, "numba.core.typing.templates", "AttributeTemplate"),
    (NUMBA, "numba.np.arrayobj", "populate_array"),
    (NUMBA, "numba.core.compiler_lock", "global_compiler_lock"),
    (NUMBA, "numba.core.codegen", "CPUCodeLibrary._optimize_functions"),
    (NUMBA, "numba.core.codegen", "CPUCodeLibrary._optimize_final_module"),
    (NUMBA, "numba.core.codegen", "CPUCodeLibrary._finalize_final_module"),
    (NUMBA, "numba.core.codegen", "CPUCodeLibrary._finalize_dynamic_globals"),
    (NUMBA, "numba.core.codegen", "JITCodeLibrary.get_pointer_to_function"),
    (NUMBA, "numba.core.codegen", "JITCodeLibrary._ensure_finalized"),
    (NUMBA, "numba.core.codegen", "JITCPUCodegen._module_pass_manager"),
    (NUMBA, "numba.core.codegen", "JITCPUCodegen.set_env"),
    (NUMBA, "numba.core.ccallback", "CFunc"),
    (NUMBA, "numba.core.compiler", "CompileResult._rebuild"),
    (NUMBA, "numba.core.compiler", "CompileResult._reduce"),
    (NUMBA, "numba.core.serialize", "dumps"),
    (DAE, "scipy_dae.integrate", "BDFDAE._step_impl"),
    (DAE, "scipy_dae.integrate", "RadauDAE._step_impl"),
    (SUNDIALS, "sksundae._cy_ida", "__file__"),
    (SUNDIALS, "sksundae._cy_common", "INT_TYPE"),
]


@pytest.mark.parametrize(("library", "module", "name"), USED, ids=[f"{m}.{n}" for _, m, n in USED])
def test_a_private_name_is_there(library, module, name):
    pytest.importorskip(module.partition(".")[0])
    found: Any = import_module(module)
    for part in name.split("."):
        found = getattr(found, part, None)
    assert found is not None, f"{library} {version(library)} has no {module}.{name} any more"


@pytest.mark.parametrize("library", private_interfaces.KNOWN)
def test_the_installed_version_is_known(library):
    words = f"{library} {version(library)} takes the public ways: try the private ones, and add it to KNOWN"
    assert private_interfaces.is_known(library), words


@pytest.mark.parametrize("name", ["solve_bdf_system", "solve_collocation_system", "norm"])
def test_steps_of_scipy_dae_call_what_is_replaced(name):
    """Else they would take their own iteration, and the replacement nothing."""
    integrate = pytest.importorskip("scipy_dae.integrate")
    called = {n for kind in (integrate.BDFDAE, integrate.RadauDAE) for n in kind._step_impl.__code__.co_names}
    assert name in called, f"steps of scipy-dae {version(DAE)} do not call {name}: {sorted(called)}"


class Pair(NamedTuple):
    """One number in, one out."""

    x: Any
    y: Any


def take_root(p: Any) -> None:
    """y = sqrt(x)."""
    p.y[0] = np.sqrt(p.x[0])


@pytest.fixture
def unknown(monkeypatch, tmp_path):
    """Other versions of all libraries, and no compiled code of the present ones."""
    monkeypatch.setattr(code, "FOLDER", tmp_path)
    monkeypatch.setattr(entries, "_CODES", {})
    monkeypatch.setattr(private_interfaces, "KNOWN", dict.fromkeys(private_interfaces.KNOWN, "none"))


def test_a_function_is_compiled_by_the_public_way(unknown, monkeypatch):
    monkeypatch.setattr(private_interfaces, "_link_without_optimising", None)  # calling it fails
    pair = Pair(np.array([4.0]), np.zeros(1))
    BoundFunction(take_root, pair)()
    assert pair.y[0] == 2.0


def test_a_callback_is_compiled_by_the_public_way(unknown, tmp_path):
    """In each process: nothing is written."""
    import numba

    path = tmp_path / "law.pickle"
    law = private_interfaces.compile_callback(lambda x: -4.0 * x, numba.float64, (numba.float64,), path)
    assert law.ctypes(0.5) == -2.0 and not path.exists()


@pytest.mark.parametrize("linear_solver", ["dense", "band", "sparse"])
@pytest.mark.parametrize("solver", ["ndf_index1", "radau_index1", "ida_index1"])
def test_a_method_of_a_library_steps_by_the_public_way(solver, linear_solver, monkeypatch):
    """Newton iterations differ, the method does not: about as many steps, and a motion within the tolerance."""
    pytest.importorskip("sksundae" if solver == "ida_index1" else "scipy_dae")
    if solver == "ida_index1":
        monkeypatch.setattr(ida, "DENSE_BELOW", 1000 if linear_solver == "dense" else 0)
        monkeypatch.setattr(ida, "BAND_WORK", 0.0 if linear_solver == "sparse" else 1e9)
    elif linear_solver != "band":
        pytest.skip("IDA alone has another")
    problem, control = make_problem("spherical_pendulum", {"t_end": 0.5}), StepControl(rtol=1e-6)
    ours = make_solver(solver).solve(problem, control)
    monkeypatch.setattr(private_interfaces, "KNOWN", dict.fromkeys((DAE, SUNDIALS), "none"))
    theirs = make_solver(solver).solve(problem, control)
    assert theirs.status == ours.status == "success", theirs.message
    assert abs(len(theirs.t) - len(ours.t)) <= 0.3 * len(ours.t), (len(theirs.t), len(ours.t))
    assert np.max(np.abs(theirs.states.r[-1] - ours.states.r[-1])) < 1e-5
