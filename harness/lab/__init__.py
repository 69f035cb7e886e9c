"""Hold experiments beyond the core: nearest true motions, ensembles, fuzzing, bundles, the ladder, the kit."""
