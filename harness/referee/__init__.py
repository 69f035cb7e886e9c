"""Judges a whole run: the paper's claims, orders, drift, symmetries and work."""
