"""Conversion of a system for an engine: a spanning tree with cut joints, the model check, the loop of stretches."""
