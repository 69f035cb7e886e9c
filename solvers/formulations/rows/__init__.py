"""Expressions that solvers evaluate, from declarations of joints and forces: constraint rows, loads, their slopes."""
