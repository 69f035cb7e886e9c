"""Compute motions for which no closed form is known, with their stated errors: ``find_reference``.

In the order of layers this is below the solvers, so that no reference can use a contestant's code.
"""
