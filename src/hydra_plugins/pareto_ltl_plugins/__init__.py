"""What Hydra finds: the sweeper that does no job twice, a launcher for Dask, and folders of other packages."""
