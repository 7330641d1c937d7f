"""Turns wind readings into a wind field with its uncertainty.

``sources`` reads files, ``observations`` projects readings into the plane of a scene, ``gp`` and ``modes``
fit the posterior, ``field`` tabulates it and keeps the tables in the cache, ``netcdf`` writes a field,
``ingest`` writes a small table from large files.
"""
