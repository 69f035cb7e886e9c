"""Hold what every room stands on: files and caches, the machine and its arithmetic, clocks, limited processes."""
