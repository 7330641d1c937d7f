"""Drake's side: a mission as a shortest path in a graph of convex sets; runs in Drake's environment.

The graph is the product of the cells of the map with the paths through the automaton: one copy of all free
cells for each leg, joined in the cells of the region where the leg ends. Paths are straight in each cell. The
convex relaxation is solved by Clarabel, then rounded: the length is the length of the best rounded path.
"""

from __future__ import annotations

import time
from importlib.metadata import version
from typing import Any

import numpy as np
from channel import serve
from pydrake.geometry.optimization import GraphOfConvexSetsOptions, HPolyhedron, Point, VPolytope
from pydrake.planning import GcsTrajectoryOptimization
from pydrake.solvers import ClarabelSolver

ROUNDED_PATHS = 10


def mission(request: dict[str, Any]) -> dict[str, Any]:
    """Length, path and CPU times for the ``orders`` of regions over the ``cells`` and their ``doors``."""
    began = time.process_time()
    gcs, start, end = product_graph(request)
    built = time.process_time()
    options = GraphOfConvexSetsOptions()
    options.convex_relaxation, options.preprocessing = True, True
    options.max_rounded_paths = ROUNDED_PATHS
    options.solver = options.restriction_solver = options.preprocessing_solver = ClarabelSolver()
    path, result = gcs.SolvePath(start, end, options)
    solved = time.process_time()
    length, line = None, None
    if result.is_success():
        pieces = [path.segment(k).control_points() for k in range(path.get_number_of_segments())]
        length = sum(float(np.hypot(*np.diff(points, axis=1)).sum()) for points in pieces)
        line = np.hstack(pieces).T.tolist()
    sets = len(gcs.graph_of_convex_sets().Vertices())
    return {"length": length, "path": line, "build": built - began, "solve": solved - built, "sets": sets}


def product_graph(request: dict[str, Any]) -> tuple[GcsTrajectoryOptimization, Any, Any]:
    """The graph, its start and its end."""
    cells = [HPolyhedron(VPolytope(np.array(cell).T)) for cell in request["cells"]]
    doors = [pair for i, j in request["doors"] for pair in ((i, j), (j, i))]
    inside: dict[str, list[int]] = request["inside"]  # numbers of the cells of each region
    gcs = GcsTrajectoryOptimization(2)
    start = gcs.AddRegions([Point(np.array(request["start"]))], order=0, h_min=0, h_max=0, name="start")
    last = sorted({i for order in request["orders"] for i in inside[order[-1]]})
    end = gcs.AddRegions([cells[i] for i in last], [], order=0, h_min=0, h_max=0, name="end")
    legs: dict[tuple[str, ...], Any] = {}  # by the regions visited before
    for order in request["orders"]:
        for k, region in enumerate(order):
            way = tuple(order[:k])
            if way not in legs:
                legs[way] = gcs.AddRegions(
                    cells, doors, order=1, h_min=0, h_max=1, name=" ".join(("leg", *way))
                )
                if k == 0:
                    gcs.AddEdges(start, legs[way])
                else:
                    passed = [(i, i) for i in inside[order[k - 1]]]
                    gcs.AddEdges(legs[way[:-1]], legs[way], edges_between_regions=passed)
            if k == len(order) - 1:
                passed = [(i, last.index(i)) for i in inside[region]]
                gcs.AddEdges(legs[way], end, edges_between_regions=passed)
    gcs.AddPathLengthCost()
    return gcs, start, end


def main() -> None:
    def handle(request: dict[str, Any]) -> dict[str, Any]:
        return {"drake": version("drake")} if request["op"] == "version" else mission(request)

    serve(handle)


if __name__ == "__main__":
    main()
