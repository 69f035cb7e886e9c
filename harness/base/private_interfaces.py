"""Use what libraries do not publish: every such use of the core is here, with its reason and the public way behind it.

Versions that are not ``KNOWN`` take the public way, which is slower and computes the same, or to the same tolerance.
Numba's events, its arrays with strides and its types of attributes have none: they are tried in every version.
``tests/harness/base/test_private_interfaces.py`` tries the public ways, and says what a new version lacks.
"""

import contextlib
import pickle
import re
import sys
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from pathlib import Path
from types import FunctionType, MethodType
from typing import Any

from .cache import read_sealed_file, write_sealed_file

# numba's option that leaves out reference counts, which take three quarters of a step of one body
WITHOUT_COUNTS = {"_nrt": False}
# beginnings of the versions of which this file knows
KNOWN = {"numba": "0.68.", "scipy-dae": "0.1.", "scikit-sundae": "1.2."}
LARGEST = 2**26  # [bytes] largest file of a callback that is read: it is held in memory before its seal is checked


def is_known(library: str) -> bool:
    """Return whether the private interfaces of the installed version of a library are known."""
    return _read_version(library).startswith(KNOWN[library])


@cache
def _read_version(library: str) -> str:
    """Return the installed version of a library."""
    from importlib.metadata import version  # its import takes longer than many commands that read this file

    return version(library)


def listen_to_compiler(begin: Callable[[], None], end: Callable[[], None]) -> Any:
    """Call ``begin`` and ``end`` around all that numba compiles or loads from its cache; return the listener.

    Numba documents these events for its developers, not for users. Without them its compiling counts as solving.
    """
    from numba.core import event

    class Listener(event.Listener):  # type: ignore[misc]
        def on_start(self, event: Any) -> None:
            begin()

        def on_end(self, event: Any) -> None:
            end()

    listener = Listener()
    for kind in ("numba:compile", "numba:compiler_lock"):  # the lock is held while code is loaded, too
        event.register(kind, listener)
    return listener


def get_attribute_template() -> Any:
    """Return the base class of numba's typing of attributes: numba publishes its decorator, but not the class."""
    from numba.core.typing.templates import AttributeTemplate

    return AttributeTemplate


def make_array_value(context: Any, builder: Any, kind: Any, data: Any, shape: list[Any], strides: list[Any]) -> Any:
    """Write the LLVM IR of an array of numba's type ``kind`` at the address ``data``, not reference-counted; return it.

    ``context`` and ``builder`` are what numba passes to an intrinsic; ``shape`` and ``strides`` [bytes] are values in
    the IR. Numba's public ``carray`` takes shapes, but no strides.
    """
    from numba.np import arrayobj

    array = context.make_array(kind)(context, builder)
    size = context.get_abi_sizeof(context.get_data_type(kind.dtype))
    arrayobj.populate_array(array, data=data, shape=shape, strides=strides, itemsize=size, meminfo=None)
    return array._getvalue()


def print_llvm(function: Any, signature: tuple[Any, ...]) -> tuple[str, str]:
    """Compile numba's ``function`` for a signature; return its optimised LLVM text and the name it has there.

    Numba has no option to link without optimising and compiling each function: five of its methods are replaced
    meanwhile. The public way makes machine code in addition, which takes two or three times as long.
    """
    if not is_known("numba"):
        function.compile(signature)
        text = function.inspect_llvm(signature)
        defined = r'^define [^\n]*?@("[^"]+"|[\w.$]+)\([^\n]*%retptr[^\n]*%arg\.'
        (name,) = re.findall(defined, text, re.MULTILINE)
        return text, name
    with _link_without_optimising():
        function.compile(signature)
    compiled = function.overloads[signature]
    module = compiled.library._final_module
    passes, builder = compiled.library.codegen._module_pass_manager()
    passes.run(module, builder)
    return str(module), compiled.fndesc.llvm_func_name


@contextlib.contextmanager
def _link_without_optimising() -> Iterator[None]:
    """Make numba link functions without optimising or compiling them, which is done once for all of an entry."""
    from numba.core.codegen import CPUCodeLibrary, JITCodeLibrary, JITCPUCodegen
    from numba.core.compiler_lock import global_compiler_lock

    def keep_layout(library: Any, module: Any) -> None:
        """Set the module's data layout, in place of numba's optimisation."""
        module.data_layout = library.codegen._data_layout

    def close(library: Any) -> None:
        """Mark a library as finalised without making machine code."""
        library._finalize_dynamic_globals()
        library._finalized = True

    aside: tuple[tuple[Any, str, Callable[..., Any]], ...] = (
        (CPUCodeLibrary, "_optimize_functions", keep_layout),
        (CPUCodeLibrary, "_optimize_final_module", lambda library: None),
        (CPUCodeLibrary, "_finalize_final_module", close),
        (JITCodeLibrary, "get_pointer_to_function", lambda library, name: library._ensure_finalized() or 0),
        (JITCPUCodegen, "set_env", lambda *given: None),
    )
    with global_compiler_lock:
        own = [vars(owner)[name] for owner, name, _ in aside]
        try:
            for owner, name, instead in aside:
                setattr(owner, name, instead)
            yield
        finally:
            for (owner, name, _), method in zip(aside, own, strict=True):
                setattr(owner, name, method)


def compile_callback(function: Callable[..., Any], returns: Any, arguments: tuple[Any, ...], path: Path | None) -> Any:
    """Return ``function`` as numba's C callback, loaded from the file ``path`` if it is there, else compiled into it.

    Numba's own cache identifies a function by its file and bytecode alone, and has no interface for another. The public
    way, taken also if ``path`` is None, compiles in each process.
    """
    import numba

    if path is None or not is_known("numba"):
        return numba.cfunc(returns(*arguments))(function)
    from numba.core.ccallback import CFunc

    callback = CFunc(function, (arguments, returns), {}, {})
    callback._cache = CallbackCache(path)
    callback.compile()
    return callback


class CallbackCache:
    """Numba's interface of a cache, for one callback in one file.

    The file is a pickle, since numba's types and machine code have no plain form. It can run code, as its contents do
    anyway, so only a file of this user is read, in a folder that no other may write to (``harness.base.cache``), and
    only as it was written: a flipped bit of machine code is another force, or a crash.
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    def load_overload(self, signature: Any, target_context: Any) -> Any:
        """Load the callback; None where the file is missing or damaged."""
        from numba.core.compiler import CompileResult

        target_context.refresh()
        try:
            return CompileResult._rebuild(target_context, *pickle.loads(read_sealed_file(self.path, LARGEST)))
        except Exception:  # a file of another version is ignored, and the law is compiled anew
            return None

    def save_overload(self, signature: Any, compiled: Any) -> None:
        """Write the compiled callback to the file, atomically, unless it refers to the memory of this process."""
        from numba.core.serialize import dumps

        if compiled.lifted or compiled.library.has_dynamic_globals:
            return
        write_sealed_file(self.path, dumps(compiled._reduce()))


def locate_sundials() -> tuple[str, Any]:
    """Return the file of a library that is linked with all of scikit-sundae's SUNDIALS, and the type of its indices.

    Scikit-sundae's own interface copies vectors, passes full matrices for banded Jacobians and calls Python for each
    residual: it is the public way (``solvers/formulations/public_ida.py``).
    """
    from sksundae import _cy_ida
    from sksundae._cy_common import INT_TYPE

    return _cy_ida.__file__, INT_TYPE


def replace_names_in_step(method: Any, names: Mapping[str, Any]) -> bool:
    """Make the step of a method of scipy_dae use our functions for these ``names`` of its module.

    Return whether it does: only for versions in ``KNOWN``. Scipy_dae takes neither Newton iterations nor norms: its
    step runs on a copy of its module's names. The public way is its own iteration and norm, with our residuals,
    Jacobians and factors.
    """
    if not is_known("scipy-dae"):
        return False
    own = type(method)
    space = vars(sys.modules[own.__module__])
    method._step_impl = MethodType(FunctionType(own._step_impl.__code__, {**space, **names}), method)
    return True
