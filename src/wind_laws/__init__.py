"""Laws of the errors of winds, and winds fitted to readings with all of their error, in a plane.

    from wind_laws.documents import packaged_law
    from wind_laws.lattice import mode_lattice, wind_lattice
    from wind_laws.tables import FitOptions, WindTask, tabulate_wind

    fine, coarse = wind_lattice(bounds, 25e3, 1e5), mode_lattice(bounds, 5e4)  # [m]
    law = packaged_law("gfs")  # law.forecast_variance(leads), law.parts; readings.error of a forecast
    task = WindTask.of(FitOptions(), readings, bounds, fine, coarse)
    wind = tabulate_wind(task).wind(task, readings)  # an UncertainWind
    wind.at(x, t), wind.time_variance(t), wind.modes

Currents of the sea count as winds. The error is a sum of parts: of the forecast, which grows with its lead;
of interpolation in space and in time; of the members of an ensemble; of a field that is held.

``error_law``                        what every law has: variances by lead, changes in time, tails
``law_of_parts`` ``forecast_error``  laws of independent parts; of one part
``documents``                        laws from their documents; packaged ones, of GFS and other models
``change_law`` ``variability``       how changes in time depend on the winds at hand
``records``                          readings in a plane, modes, the field
``gp`` ``places``                    Gaussian processes fitted to readings; what depends on their places alone
``lattice``                          regular lattices, and values between their nodes
``modes``                            Karhunen-Loeve modes of the error, and how long it lasts
``tables``                           a fit as one task and one table, which can be kept on disk
``tails`` ``drift``                  scales of errors, drawn and weighted; how far errors displace a flight
``conditioned`` ``between``          a field given position fixes; winds known at nodes and times only

The modules are imported by name; this one loads nothing. Positions are in [m], times in [s], winds in [m/s].
"""
