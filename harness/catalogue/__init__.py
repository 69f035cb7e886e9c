"""Catalogue problems and solvers with their options, from this tree and from plugins."""
