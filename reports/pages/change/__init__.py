"""Pages of what changed: two results folders compared, and the history of all."""
