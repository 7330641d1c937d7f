"""From NOAA data to a wind field with honest uncertainty.

``sources`` reads and projects, ``gp`` fits, ``field`` tabulates, caches and stores.
"""
