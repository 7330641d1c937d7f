"""OMPL's side: one leg of a mission, from a point into a polygon; runs in OMPL's environment.

The collision test is one call of compiled Python code for each motion. Budgets are CPU time. AORRTC in OMPL
2.0.1 has two limits: with metres it "failed to find any neighbours", so the unit is 100 km; and with more
than one goal state it does not return, so its goal is the nearest point of the region.
"""

from __future__ import annotations

import time
from importlib.metadata import version
from typing import Any

import numba
import numpy as np
from channel import serve
from ompl import base as ob
from ompl import geometric as og
from ompl import util as ou

GOAL_POINTS = 64  # points of the goal on its outline, just inside

PLANNERS = {"RRTstar": og.RRTstar, "AORRTC": og.AORRTC}


def faces_of(polygons: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Inward normals and offsets (F, 3) of convex counter-clockwise polygons, and where each begins."""
    rows, begins = [], [0]
    for polygon in polygons:
        edge = np.roll(polygon, -1, axis=0) - polygon
        normal = np.column_stack([-edge[:, 1], edge[:, 0]])
        rows.append(np.column_stack([normal, (normal * polygon).sum(axis=1)]))
        begins.append(begins[-1] + len(polygon))
    return np.concatenate([np.empty((0, 3)), *rows]), np.array(begins)


def segment_test(polygons: list[np.ndarray]) -> Any:
    """Compiled: whether the segment between two points crosses no polygon."""
    faces, begins = faces_of(polygons)

    @numba.njit("boolean(float64, float64, float64, float64)")
    def clear(x0: float, y0: float, x1: float, y1: float) -> bool:
        for k in range(len(begins) - 1):
            enter, leave = 0.0, 1.0
            for f in range(begins[k], begins[k + 1]):
                here = faces[f, 0] * x0 + faces[f, 1] * y0 - faces[f, 2]
                there = faces[f, 0] * x1 + faces[f, 1] * y1 - faces[f, 2]
                if here <= 0 and there <= 0:
                    leave = -1.0
                    break
                if here < 0:
                    enter = max(enter, here / (here - there))
                elif there < 0:
                    leave = min(leave, here / (here - there))
            if enter < leave:
                return False
        return True

    return clear


class Anywhere(ob.StateValidityChecker):
    """Start and goals are known to be free; motions are tested by ``Motions``."""

    def isValid(self, state: Any) -> bool:  # noqa: N802
        return True


class Motions(ob.MotionValidator):
    def __init__(self, space: Any, clear: Any) -> None:
        super().__init__(space)
        self.clear = clear
        self.calls = 0

    def checkMotion(self, a: Any, b: Any) -> bool:  # noqa: N802
        self.calls += 1
        return bool(self.clear(a[0], a[1], b[0], b[1]))


class Map:
    """A map as OMPL's space; ``side`` is its width and height, or both."""

    def __init__(self, side: float | list[float], obstacles: list[list[list[float]]]) -> None:
        self.space = ob.RealVectorStateSpace(2)
        bounds = ob.RealVectorBounds(2)
        for axis, length in enumerate(np.broadcast_to(side, 2)):
            bounds.setLow(axis, 0.0)
            bounds.setHigh(axis, float(length))
        self.space.setBounds(bounds)
        self.information = ob.SpaceInformation(self.space)
        self.clear = segment_test([np.array(polygon) for polygon in obstacles])
        self.motions = Motions(self.information, self.clear)
        self.information.setStateValidityChecker(Anywhere(self.information))
        self.information.setMotionValidator(self.motions)
        self.information.setup()

    def state(self, point: Any) -> Any:
        state = self.space.allocState()
        state[0], state[1] = float(point[0]), float(point[1])
        return state

    def leg(
        self,
        planner: str,
        start: list[float],
        goal: list[list[float]],
        seconds: float | None,
        step: float | None,
    ) -> dict[str, Any]:
        """The path from ``start`` into ``goal`` after ``seconds`` of CPU; if None the first one."""
        problem = ob.ProblemDefinition(self.information)
        problem.addStartState(self.state(start))
        goals = ob.GoalStates(self.information)
        points = outline_points(np.array(goal))
        if planner == "AORRTC":
            points = points[[np.hypot(*(points - start).T).argmin()]]
        for point in points:
            goals.addState(self.state(point))
        problem.setGoal(goals)
        shortest = ob.PathLengthOptimizationObjective(self.information)
        if seconds is None:
            shortest.setCostThreshold(ob.Cost(np.inf))  # any path will do, which only RRT* asks for
        problem.setOptimizationObjective(shortest)
        made = PLANNERS[planner](self.information)
        if step is not None:
            made.setRange(step)
        made.setProblemDefinition(problem)
        made.setup()
        calls, wall, cpu = self.motions.calls, time.perf_counter(), time.process_time()
        end = cpu + (5.0 if seconds is None else seconds)
        done = ob.PlannerTerminationCondition(lambda: time.process_time() >= end)
        if seconds is None:
            done = ob.plannerOrTerminationCondition(ob.exactSolnPlannerTerminationCondition(problem), done)
        made.solve(done)
        cpu, wall = time.process_time() - cpu, time.perf_counter() - wall
        data = ob.PlannerData(self.information)
        made.getPlannerData(data)
        told = {
            "cpu": cpu,
            "wall": wall,
            "vertices": data.numVertices(),
            "checks": self.motions.calls - calls,
        }
        if not problem.hasExactSolution():
            return told | {"length": None}
        path = problem.getSolutionPath()
        states = [path.getState(k) for k in range(path.getStateCount())]
        line = [[state[0], state[1]] for state in states]
        return told | {"length": path.length(), "end": line[-1], "path": line}

    def check_seconds(self, calls: int = 20_000) -> float:
        """CPU time of one collision test through OMPL [s]."""
        a, b = self.state([0.1, 0.1]), self.state([0.5, 0.4])
        began = time.process_time()
        for _ in range(calls):
            self.information.checkMotion(a, b)
        return (time.process_time() - began) / calls


def outline_points(polygon: np.ndarray) -> np.ndarray:
    """Points at equal distances on the outline of a convex polygon that is shrunk by half a per cent."""
    inner = polygon.mean(axis=0) + 0.995 * (polygon - polygon.mean(axis=0))
    closed = np.vstack([inner, inner[:1]])
    along = np.append(0.0, np.cumsum(np.hypot(*np.diff(closed, axis=0).T)))
    at = np.linspace(0.0, along[-1], GOAL_POINTS, endpoint=False)
    return np.column_stack([np.interp(at, along, closed[:, axis]) for axis in range(2)])


def main() -> None:
    ou.setLogLevel(ou.LOG_NONE)
    ou.RNG.setSeed(1)
    maps: dict[str, Map] = {}

    def handle(request: dict[str, Any]) -> dict[str, Any]:
        if request["op"] == "version":
            return {"ompl": version("ompl")}
        if request["op"] == "map":
            made = maps[request["name"]] = Map(request["side"], request["obstacles"])
            return {"check_seconds": made.check_seconds()}
        return maps[request["name"]].leg(
            request["planner"], request["start"], request["goal"], request["seconds"], request["step"]
        )

    serve(handle)


if __name__ == "__main__":
    main()
