"""The paper's evaluation and more, as stages of pipelines.

``compare`` runs several planners in the same winds, ``convergence`` measures plans as trees grow,
``ablation`` changes one setting at a time, ``hindcast`` flies plans through full wind fields from GRIB files,
``forecast_test`` those that were made from what was known hours before, ``departure`` plans one mission for
many starts.
Each consists of independent pieces (a method and a seed, for example): ``parts`` spreads them over processes
and keeps each result on disk, so that a stopped run continues. ``jobs`` is the engine of studies and sweeps.
"""
