"""One process with limits, for code that may hang, crash or lie."""
