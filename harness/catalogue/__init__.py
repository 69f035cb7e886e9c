"""Catalogue problems and solvers with their options, plug-ins, suites of runs, and digests of the code."""
