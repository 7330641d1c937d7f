"""Turns wind readings into a wind field with its uncertainty.

``sources`` reads files, ``observations`` projects readings into the plane of a scene, ``gp`` and ``modes``
fit the posterior, ``field`` tabulates it, ``fit_cache`` stores the tables, ``netcdf`` writes a field,
``ingest`` writes a small table from large files.
"""
