"""A second reader of wind files, for comparison with the readings of a run.

It shares no code with the planner: GRIB is decoded with ecCodes, NetCDF with xarray, tables with :mod:`csv`.
Components along the axes of a grid are turned by differences of its latitudes and longitudes. It reads the
usual kinds; of other files it says that they are not checked (:class:`UnreadError`).
"""
