"""Judge results: the paper's claims, orders, drift, symmetries, work and false successes.

The entry point is ``judge``; its findings have the types of ``harness.results.judgements``.
"""
