"""Judges results: the paper's claims, orders, drift, symmetries, work and false successes. The door is ``judge``; what
it finds are the shapes of ``harness.results.judgements``.
"""
