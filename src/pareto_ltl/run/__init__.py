"""One run: its stages, its results directory, where it came from."""
