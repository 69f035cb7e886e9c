"""Exact and certified motions for the problems: computed without any of the solvers."""
