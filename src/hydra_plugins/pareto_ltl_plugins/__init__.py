"""What Hydra finds: a sweeper that does no job twice, a launcher for Dask, folders of other packages."""
