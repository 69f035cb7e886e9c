"""Machine code from expressions: CasADi expressions -> tape -> LLVM IR -> object file kept on disk -> address.

``compile_functions`` takes expressions and returns ``Code``, whose functions take pointers to flat arrays only:
straight-line functions of whole arrays, and loops over many elements with index tables. ``Program`` runs a list of
such calls from Python by one call; ``calls.call`` calls an address from numba.
"""

from .code import Code, compile_functions
from .functions import Loop, Straight
from .program import Program

__all__ = ["Code", "Loop", "Program", "Straight", "compile_functions"]
