"""Exact and certified motions for the problems: they owe nothing to any solver."""
