"""Provide exact and certified motions of the problems, computed without any of the solvers."""
