"""One run: stages, runner, results directory, provenance, and the Python interface."""
