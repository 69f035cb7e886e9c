"""The interactive plots of a problem: what each shows, from records and decimated series."""
