"""Quantities of flight: heights and levels as people state them, the air there, and planes on the Earth.

``levels``      levels of winds and currents: ``10m``, ``300m amsl``, ``925hPa``, ``50m depth``, ``FL45``
``lengths``     lengths and heights with units and datum, as maps state them: ``5 km``, ``500 ft AMSL``
``atmosphere``  the standard atmosphere; true and calibrated airspeed; units of temperature
``heights``     the height of a flight, and the air there: standard, or from what was measured nearby
``medium``      the words for air with its wind, or water with its current
``frames``      a plane on the Earth and a clock: metres to degrees, true north, scale, lines, times
``sphere``      longitudes and unit vectors

    from flight_quantities.frames import Frame
    from flight_quantities.levels import parse_level

    parse_level("1000ft amsl").text                 # '304.8m amsl'
    Frame.at(37.0, -92.0).to_plane(-91.5, 37.2)     # (1, 2) [m]

All numbers are in SI units, angles as stated. The modules are imported by name; this one loads nothing, and
only ``frames`` needs pyproj. Nothing here knows of missions, settings or plans.
"""
