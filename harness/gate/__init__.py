"""Thresholds, and whether results keep them."""
