"""A launcher for Hydra on an existing cluster of Dask."""
