"""The engines' side: one file an engine, which imports numpy and the engine alone (module ``export.protocol``)."""
