"""The extras of the distribution: what only some uses need."""

from declared_settings import Extras

EXTRAS = Extras(
    "pareto-ltl",
    {  # of each extra in pyproject.toml that the package imports, except launchers of Hydra
        "netcdf": ("xarray", "cf_xarray"),
        "grib": ("cfgrib", "eccodes"),
        "serve": ("starlette", "uvicorn", "PIL", "pmtiles", "mapbox_vector_tile"),
        "follow": ("pymavlink", "serial"),
        "scores": ("scores",),
        "sim": ("jsbsim",),
        "dask": ("distributed",),
    },
)
