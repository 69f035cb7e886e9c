"""Measure orders, drift, symmetries and work, each with its evidence."""
