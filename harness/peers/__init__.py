"""Other people's engines beside ours: today Exudyn."""
