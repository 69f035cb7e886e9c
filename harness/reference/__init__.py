"""Motions that are computed because none is known in closed form, with their stated errors: ``reference_of``.

Below the solvers in the order of layers, so that no reference can use a contestant's code.
"""
