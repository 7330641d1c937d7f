"""Risk-aware temporal-logic mission planning in uncertain wind, without position fixes.

    import pareto_ltl

    result = pareto_ltl.plan("phi1", "F(a & F b & F c)", wind="calm")
    result.plan, result.front, result.wind       # its records, made when asked for, each with plot()
    result.given(wind=field).plan                # the same mission in another wind
    pareto_ltl.plan(geodataframe, "F a", wind=dataset)  # a map of GeoPandas, a wind of xarray ...
    result.front.to_pandas(), result.to_xarray()        # ... and back
    pareto_ltl.choose(result, failure=0.02)      # another path of the front, without planning again
    pareto_ltl.export(result, "flight")          # files for autopilots, maps and navigators
    pareto_ltl.show(result)                      # one page with map, front, flights, in a browser
    pareto_ltl.replan(result, "6h", (38.1, -94.2, 500.0))  # the rest of the flight, from a position fix
    pareto_ltl.beacons(result)                   # where a beacon would reduce the failure most
    pareto_ltl.contain(result)                   # how often it leaves its border, and the air that it needs
    pareto_ltl.check(result, "newer.grib2")      # go or wait: the plan in a newer forecast, by your limits
    pareto_ltl.follow(result, "telemetry.csv")   # a flight watched: position, promise of the rest, alarms
    pareto_ltl.simulate(result, runs=1000, law="coherent")
    pareto_ltl.read_map("map.kml")               # the checked map; its frame converts longitude and latitude
    pareto_ltl.read_formula("F(a & F b)").accepts([{"a"}, {"b"}])  # what a mission means
    pareto_ltl.steer(result, (0, 0), (9e4, 2e4))  # a path between two points, by the convex programme
    pareto_ltl.load_results("outputs/phi1/...")  # a run of the command line
    pareto_ltl.read_wind("forecast.grib2")  # the readings of a file, whose kind follows from its content
    pareto_ltl.verify("outputs/phi1/...")  # every claim of its files derived again, without the planner

The command line is ``pareto-ltl plan +experiment=phi1``, or ``python -m pareto_ltl +experiment=phi1``. The
names stand in ``__init__.pyi`` and are imported when they are used, so that ``import pareto_ltl`` loads no
numerical package.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

from careful_io.stated_names import stated_names

__version__ = "1.0.0"

__all__ = sorted((*stated_names(__file__), "__version__"))  # noqa: PLE0605


def __getattr__(name: str) -> Any:
    module = stated_names(__file__).get(name)
    if module is None:
        raise AttributeError(f"module 'pareto_ltl' has no attribute {name!r}")
    if module.partition(".")[0] == __name__:
        return getattr(import_module(module), name)
    # of an application, or of the checker: the planner imports neither
    from pareto_ltl.support.extensions import INTERFACE

    return INTERFACE.required(name)


def __dir__() -> list[str]:
    return __all__
