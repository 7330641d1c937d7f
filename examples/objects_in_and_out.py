"""A wind from xarray and a map from GeoPandas go in; a table, a dataset and features come out."""

import geopandas as gpd
import numpy as np
import pandas as pd
import shapely
import xarray as xr

import pareto_ltl

lat, lon = np.arange(34.0, 42.1, 1.0), np.arange(-98.0, -87.9, 1.0)
times = pd.date_range("2026-03-01", periods=9, freq="3h")
grid = ("time", "latitude", "longitude")
east = np.broadcast_to(3.0 + 0.3 * (lat - 34.0)[:, None], (len(times), len(lat), len(lon)))
wind = xr.Dataset(  # any CF dataset: of xarray.open_dataset, of a server, of your own model
    {
        "u10": (grid, east, {"standard_name": "eastward_wind", "units": "m s-1"}),
        "v10": (grid, np.ones_like(east), {"standard_name": "northward_wind", "units": "m s-1"}),
    },
    {
        "time": times,
        "latitude": ("latitude", lat, {"units": "degrees_north"}),
        "longitude": ("longitude", lon, {"units": "degrees_east"}),
    },
)
places = gpd.GeoDataFrame(
    {"role": ["start", "region", "obstacle"], "name": ["base", "a", "town"]},
    geometry=[
        shapely.Point(-94.0, 37.0),
        shapely.box(-91.8, 38.2, -91.2, 38.6),
        shapely.box(-93.2, 37.2, -92.6, 38.0),
    ],
    crs="EPSG:4326",
)

scene = pareto_ltl.read_map(places)
print(scene, scene.frame.lonlat(scene.start[None]))
result = pareto_ltl.plan(scene, "F a", wind=wind, planner={"trees": 4, "n_max": 1500}, seed=1)
print(result.front.to_pandas()[["failure", "length_m", "duration_s"]])  # a table of pandas
print(result.wind.at(result.plan.path.x[:2], 3600.0))  # expected wind on the first leg after an hour [m/s]
print(result.to_xarray())  # wind and path, with units
print(gpd.GeoDataFrame.from_features([result.plan.__geo_interface__]))  # the path, in degrees
