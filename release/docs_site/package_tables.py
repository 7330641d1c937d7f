"""What an installation brings, with size, licence and purpose, of an environment with all extras.

``python release/docs_site/package_tables.py`` prints the tables; on the site they stand in
``docs/install.md``, in place of ``<!-- packages -->``. The page itself states number and size.
"""

from __future__ import annotations

import re
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path

from packaging.requirements import Requirement

MARK = "<!-- packages -->"
PROJECT = "pareto-ltl"
OF_CLASSIFIER = "License :: OSI Approved :: "
PURPOSES = {
    "clarabel": "solver of the last programme of every path",
    "cvxpy-base": "statement of that programme (cvxpy without solvers)",
    "fastjsonschema": "checks of results that are read",
    "filelock": "locks of directories and of the cache",
    "h5netcdf": "wind.nc of every run, NetCDF exports",
    "h5py": "the HDF5 library for h5netcdf",
    "hydra-core": "settings, sweeps",
    "jinja2": "the page of a result",
    "joblib": "processes of sweeps and studies",
    "matplotlib": "figures",
    "moocore": "non-dominated points, hypervolume",
    "networkx": "graph of the cells, and its product with the automaton",
    "numba": "compiles the kernels",
    "numpy": "arrays",
    "platformdirs": "the cache folder of a user",
    "psutil": "memory, processes",
    "pyproj": "map projections",
    "pyyaml": "settings, pipelines",
    "rich": "progress, tables on a terminal",
    "scikit-learn": "Gaussian process of the wind",
    "scipy": "linear algebra, distributions, sparse matrices",
    "shapely": "geometry of maps",
}
EXTRAS = {
    "netcdf": "winds and currents from NetCDF files",
    "grib": "winds from GRIB files",
    "serve": "the planning desk, the page in flight",
    "follow": "telemetry and messages of autopilots",
    "sweep": "sweeps on all cores",
    "cluster": "sweeps through SLURM",
    "dask": "sweeps and studies on a cluster of Dask",
    "scores": "diagrams and comparisons of forecast tests",
    "sim": "flights of an independent aircraft (JSBSim)",
}


def normal(name: str) -> str:
    """The name of a package as indexes compare it."""
    return re.sub(r"[-_.]+", "-", name).lower()


def needed(extras: tuple[str, ...] = ()) -> dict[str, tuple[Distribution, list[str]]]:
    """The installed packages that the project needs with ``extras``, with what needs each, by name."""
    found: dict[str, tuple[Distribution, list[str]]] = {}
    users: dict[str, list[str]] = {}
    queue, seen = [(PROJECT, extras)], {(PROJECT, extras)}
    while queue:
        name, wanted = queue.pop()
        try:
            package = distribution(name)
        except PackageNotFoundError:
            continue
        found[name] = package, users.setdefault(name, [])
        for line in package.requires or ():
            requirement = Requirement(line)
            marker = requirement.marker
            if marker is None or any(marker.evaluate({"extra": extra}) for extra in ("", *wanted)):
                key = normal(requirement.name)
                if name not in users.setdefault(key, []):
                    users[key].append(name)
                entry = key, tuple(sorted(requirement.extras))
                if entry not in seen:
                    seen.add(entry)
                    queue.append(entry)
    del found[PROJECT]
    return dict(sorted(found.items()))


def licence(package: Distribution) -> str:
    """The licence that a package states: its SPDX expression, else its classifiers, else its first line."""

    def fields(name: str) -> list[str]:  # a field that is not there is None or a KeyError, as the reader is
        return package.metadata.get_all(name) or []

    classifiers = [c.removeprefix(OF_CLASSIFIER) for c in fields("Classifier") if OF_CLASSIFIER in c]
    first = "".join(fields("License")).strip().split("\n")[0][:60]
    return "".join(fields("License-Expression")) or ", ".join(classifiers) or first or "not stated"


def megabytes(package: Distribution) -> float:
    """Size of the installed files of a package, without compiled Python [MB]."""
    paths = (Path(str(file.locate())) for file in package.files or () if file.suffix != ".pyc")
    return sum(path.stat().st_size for path in paths if path.is_file()) / 1e6


def tables() -> str:
    """Our requirements, the packages that these need by licence, and what each extra adds."""
    core = needed()
    sizes = {name: megabytes(package) for name, (package, _) in core.items()}
    lines = ["| package | licence | MB | what for |", "|---|---|---|---|"]
    others: dict[str, list[str]] = {}
    for name, (package, _) in core.items():
        if name in PURPOSES:
            lines.append(f"| {name} | {licence(package)} | {sizes[name]:.1f} | {PURPOSES[name]} |")
        else:
            others.setdefault(licence(package), []).append(f"{name} {sizes[name]:.1f}")
    lines += ["", "| licence | packages that these need [MB] |", "|---|---|"]
    lines += [f"| {name} | {', '.join(others[name])} |" for name in sorted(others)]
    lines += ["", "| extra | what for | MB more | packages |", "|---|---|---|---|"]
    for extra, use in EXTRAS.items():
        more = {name: package for name, (package, _) in needed((extra,)).items() if name not in core}
        size = sum(megabytes(package) for package in more.values())
        lines.append(f"| `{extra}` | {use} | {size:.1f} | {', '.join(more)} |")
    return "\n".join(lines)


def with_packages(markdown: str) -> str:
    """A page of the site with the tables in place of the mark."""
    return markdown.replace(MARK, tables()) if MARK in markdown else markdown


if __name__ == "__main__":
    print(tables())
    found = [megabytes(package) for package, _ in needed().values()]
    print(f"\nWithout extras: {len(found)} packages, {sum(found):.0f} MB.")
