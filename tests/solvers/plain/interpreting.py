"""Functions of compiled methods run as the plain Python that they are written in, on the arrays of their bundles.

Machine code calls them by address as it calls itself; only functions that ``choose`` names are interpreted, and all
others stay machine code. An exception in one of them is raised where a function was called from Python.
"""

import ctypes

import numpy as np

from mbsbench.solvers.formulations.compiled import entries
from mbsbench.solvers.formulations.compiled.entries import BoundFunction
from mbsbench.solvers.formulations.generated import Program
from mbsbench.solvers.formulations.generated.program import compile_runner

CALLBACK = ctypes.CFUNCTYPE(None, ctypes.c_void_p)
LAW = ctypes.CFUNCTYPE(None, ctypes.c_double, ctypes.c_void_p, ctypes.c_void_p)
raised: list[BaseException] = []  # at most one, until it is raised again


class Fields:
    """A record as compiled code sees it: fields are read and written by name, floats divide as in machine code."""

    def __init__(self, record):
        object.__setattr__(self, "_record", record)

    def __getattr__(self, name):
        return self._record[name][()]

    def __setattr__(self, name, value):
        self._record[name] = value


def view_records(bundle):
    """Return the bundle, and the bundles in it, with ``Fields`` in place of records."""
    given = {}
    for name, x in zip(bundle._fields, bundle, strict=True):
        if isinstance(x, np.ndarray) and x.dtype.names:
            given[name] = Fields(x)
        else:
            given[name] = view_records(x) if isinstance(x, tuple) else x
    return type(bundle)(**given)


class PythonFunction(Program):
    """A function with its bundle, called by Python or by machine code, and run by Python's interpreter."""

    def __init__(self, function, bundle):
        self.function, self.bundle = function, view_records(bundle)
        self.callback = CALLBACK(self._answer)
        address = ctypes.cast(self.callback, ctypes.c_void_p).value
        Program.__init__(self, [(address, [np.zeros(1)])], (self.callback, bundle))

    def _answer(self, _):
        if not raised:  # what is to come after an exception is of no use
            try:
                self.function(self.bundle)
            except Exception as error:
                raised.append(error)


def run(entry):
    """Run a program, or that at an address."""
    if isinstance(entry, Program):
        entry.run()
    else:
        compile_runner().function("run", 1)(int(entry) + 8)
    raise_again()


def raise_again():
    """Raise what a function called by machine code has raised."""
    if raised:
        error = raised[0]
        raised.clear()
        raise error


def call_law(address, t, state, load):
    """Call a user's law at its address."""
    LAW(int(address))(t, state.ctypes.data, load.ctypes.data)


choices = [lambda function: False]  # the last one chooses the functions that are interpreted


def interpret(choose):
    """From now on, in this process, make Python's interpreter run each function for which ``choose(function)`` holds.

    Nothing may have been compiled in this process: numba's functions take the place of those in the modules.
    """
    choices.append(choose)
    if BoundFunction.__call__ is call:
        return
    compile_function = BoundFunction.__init__

    def bind(self, function, bundle):
        if choices[-1](function):
            self.__class__ = PythonBoundFunction
            PythonFunction.__init__(self, function, bundle)
        else:
            compile_function(self, function, bundle)

    BoundFunction.__init__, BoundFunction.__call__ = bind, call
    # other modules have these functions by their own names: what they do is replaced
    entries.run.__code__, entries.call_law.__code__ = run_here.__code__, call_law_here.__code__


def call(self):
    """Run a bound function, and raise what it raises: the method of ``BoundFunction`` from then on."""
    self.run()
    raise_again()


class PythonBoundFunction(PythonFunction, BoundFunction):
    """What a bound function that is interpreted becomes."""


def run_here(entry):
    """Run a program; the code of ``entries.run`` while functions are interpreted."""
    from mbsbench.tests.solvers.plain import interpreting

    interpreting.run(entry)


def call_law_here(address, t, state, load):
    """Call a law; the code of ``entries.call_law`` while functions are interpreted."""
    from mbsbench.tests.solvers.plain import interpreting

    interpreting.call_law(address, t, state, load)
