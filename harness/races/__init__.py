"""Who is faster: the runs of a problem timed in turns, and the search for the cheapest setting that meets an error."""
