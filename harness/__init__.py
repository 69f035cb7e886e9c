"""Runs problems through solvers, measures what comes back and judges it."""
