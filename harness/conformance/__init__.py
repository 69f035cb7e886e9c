"""What a solver or a problem must satisfy, each requirement with its measured number."""
