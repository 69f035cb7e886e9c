"""From a system to an engine: a spanning tree with cut joints, the model check, the loop of stretches."""
