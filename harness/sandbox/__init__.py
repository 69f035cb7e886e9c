"""Run code that may hang, crash or lie in a process with limits."""
