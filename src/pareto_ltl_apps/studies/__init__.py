"""The paper's evaluation and further studies, as stages of pipelines.

``compare`` runs several planners in the same winds, ``convergence`` measures plans as trees grow,
``ablation`` changes one setting at a time, ``hindcast`` flies plans through full wind fields from GRIB files,
``forecast_test`` plans made from forecasts that were known hours before, ``departure`` plans one mission for
many departures.

Each consists of independent parts (for example, one method and one seed). ``parts`` distributes them over
processes and stores each result on disk, so that a stopped run can continue. ``jobs`` is the engine of
studies and sweeps.
"""
