"""The engines' side of ``export.protocol``: one file an engine, which imports numpy and the engine alone."""
