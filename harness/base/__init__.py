"""Hold what every room stands on: files and caches, the machine, its arithmetic and code for it, clocks, processes."""
