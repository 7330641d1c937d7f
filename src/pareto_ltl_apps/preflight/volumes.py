"""Volumes in time along a route, the smallest that hold a flight with a given probability.

A volume is a convex polygon for each leg, which is active while the leg is flown: the hull of two ellipses
about the expected positions at both ends of the leg. A flight is inside while both ends of each of its steps
lie in the polygon of that step; between them it flies straight.

The ellipses have the shape of the covariance of simulated flights, and a size and elongation that are chosen
(:class:`Shape`) so that the sum of area and time is least. Among the shapes are circles of one radius, the
fixed buffer, so that the chosen volumes are not larger except for the chance of the flights.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from pareto_ltl.extend import FlightSample
from pareto_ltl.support.arrays import BoolArray, FloatArray
from pareto_ltl_apps.exports.corridor import FINEST, ellipse_sizes
from pareto_ltl_apps.exports.ellipses import ellipse_outlines
from pareto_ltl_apps.exports.geojson import LATERAL_FLOOR, leg_hulls

CORNERS = 36  # corners of the polygon around an ellipse, which is 0.4 % wider
STILL = 1e-6  # [m] shorter steps have no course
SEARCHES = 90  # shapes tried from each start of the search
SHRINKS = 6  # halvings of how much smaller than their ellipses polygons may be
TIGHTEST = 0.85  # size of the smallest polygons tried, of their ellipses
LEFT_LEAST = 20  # weighted flights that leave the largest size considered
WORST = 0.1  # least share of the flights, those that deviate most, that shapes are compared with


@dataclass(frozen=True, slots=True)
class Volumes:
    """One convex polygon for each leg of a plan of T steps.

    Attributes
    ----------
    outlines : tuple of T (M, 2) float
        Corners [m], counter-clockwise.
    dt : float
        Duration of each leg [s].
    """

    outlines: tuple[FloatArray, ...]
    dt: float

    @property
    def volume_time(self) -> float:
        """Sum over the legs of area times duration [m² s]."""
        return self.dt * sum(polygon_area(corners) for corners in self.outlines)

    def left_by(self, x: FloatArray) -> BoolArray:
        """Which of the flights ``x`` (n, T+1, 2) [m] leave the volumes, (n,)."""
        import shapely

        areas: Any = np.array([shapely.Polygon(corners) for corners in self.outlines])
        shapely.prepare(areas)
        left = np.zeros(len(x), bool)
        for k, area in enumerate(areas):
            for t in (k, k + 1):
                left |= ~shapely.intersects_xy(area, x[:, t, 0], x[:, t, 1])
        return left


def polygon_area(corners: FloatArray) -> float:
    """Area of a polygon (M, 2) [m²], positive if it is counter-clockwise."""
    after = np.roll(corners, -1, axis=0)
    return 0.5 * float((corners[:, 0] * after[:, 1] - after[:, 0] * corners[:, 1]).sum())


# --- the shape -----------------------------------------------------------------------------------


class Shape(NamedTuple):
    """How ellipses differ from the covariance Σ_t of the flights, with m_t half its trace.

        Q_t = f_t² S_t ((1 - round) Σ_t + round m_t I) S_t (m / m_t)^even,    m = mean of m_t,

    S_t stretches by ``along`` in the direction of flight, and f_t = exp(tilt (τ - ½) + bow (2τ - 1)²) with
    τ = t / T. ``round`` = ``even`` = 1 are circles of one radius.

    Eq. (M76) of docs/mathematics_methods.md.
    """

    along: float = 1.0
    round: float = 0.0
    even: float = 0.0
    tilt: float = 0.0
    bow: float = 0.0

    @classmethod
    def of(cls, values: FloatArray) -> Shape:
        """The shape of free numbers (5,): the logarithm of ``along``, and the others within their range."""
        log_along, circle, even, tilt, bow = values.tolist()
        return cls(
            math.exp(min(max(log_along, -1.0), 2.0)), min(max(circle, 0.0), 0.99), min(max(even, 0.0), 1.0),
            tilt, bow,
        )  # fmt: skip

    def values(self) -> tuple[float, ...]:
        """The free numbers of the shape."""
        return math.log(self.along), *self[1:]


PLAIN_SHAPES = (Shape(1.3, 0.3), Shape(1.0, 1.0, 1.0))  # for rare levels: ellipses, and a fixed buffer
STARTS = ((0.3, 0.1, 0.1, 0.0, 0.0), (0.2, 0.9, 0.9, 0.0, 0.0))  # of the search: ellipses, and a fixed buffer


@dataclass(frozen=True, slots=True)
class Deviations:
    """Where the flights of a plan are expected: mean (T+1, 2) [m], covariance (T+1, 2, 2) [m²], courses.

    Attributes
    ----------
    course : (T+1, 2) float
        Unit vectors of the direction of flight; zero where the robot stands still.
    dt : float
        Duration of a step [s].
    """

    mean: FloatArray
    cov: FloatArray
    course: FloatArray
    dt: float

    @classmethod
    def of(cls, x: FloatArray, dt: float) -> Deviations:
        """Of flights ``x`` (n, T+1, 2) [m]; 1 m is added, so that a certain position has an ellipse too."""
        mean = x.mean(axis=0)
        off = np.moveaxis(x - mean, 1, 0)  # (T+1, n, 2)
        cov = np.swapaxes(off, 1, 2) @ off / len(x) + FINEST**2 * np.eye(2)
        steps = np.diff(mean, axis=0)
        size = np.linalg.norm(steps, axis=1, keepdims=True)
        unit = np.where(size > STILL, steps / np.maximum(size, STILL), 0.0)
        both = np.vstack([unit[:1], unit[:-1] + unit[1:], unit[-1:]])
        size = np.linalg.norm(both, axis=1, keepdims=True)
        return cls(mean, cov, np.where(size > STILL, both / np.maximum(size, STILL), 0.0), dt)

    def ellipses(self, shape: Shape) -> FloatArray:
        """Q_t (T+1, 2, 2) [m²] of a ``shape``."""
        middle = 0.5 * np.trace(self.cov, axis1=1, axis2=2)
        time = np.linspace(0.0, 1.0, len(middle))
        size = np.exp(shape.tilt * (time - 0.5) + shape.bow * (2.0 * time - 1.0) ** 2)
        size *= (middle.mean() / middle) ** (0.5 * shape.even)
        circle = middle[:, None, None] * np.eye(2)
        stretch = np.eye(2) + (shape.along - 1.0) * self.course[:, :, None] * self.course[:, None, :]
        blend = (1.0 - shape.round) * self.cov + shape.round * circle
        return np.asarray(size[:, None, None] ** 2 * (stretch @ blend @ stretch), float)

    def products(self, x: FloatArray) -> FloatArray:
        """Squares and product (3, T+1, n) [m²] of the deviations of flights ``x`` (n, T+1, 2)."""
        east, north = np.moveaxis(x - self.mean, 2, 0).swapaxes(1, 2)
        return np.stack([east * east, 2.0 * east * north, north * north])

    def sizes(self, shape: Shape, products: FloatArray) -> FloatArray:
        """Sizes (n,) of the smallest ellipses that hold all positions of each flight of :meth:`products`."""
        inverse = np.linalg.inv(self.ellipses(shape))
        squares = inverse[:, 0, 0, None] * products[0]
        squares += inverse[:, 0, 1, None] * products[1]
        squares += inverse[:, 1, 1, None] * products[2]
        return np.asarray(np.sqrt(squares.max(axis=0)), float)

    def hulls(self, shape: Shape, size: float) -> Any:
        """Shapely polygons (T,) of the legs about ellipses of ``size``."""
        scale = np.full(len(self.mean), size)
        return leg_hulls(ellipse_outlines(self.mean, self.ellipses(shape), scale, CORNERS))

    def volumes(self, shape: Shape, size: float) -> Volumes:
        """The volumes about ellipses of ``size``, at least ``LATERAL_FLOOR`` about each leg."""
        import shapely

        legs = shapely.buffer(shapely.linestrings(list(pairwise(self.mean))), LATERAL_FLOOR)
        areas = shapely.convex_hull(shapely.union(self.hulls(shape, size), legs))
        return Volumes(outlines_of(areas), self.dt)


def outlines_of(areas: Any) -> tuple[FloatArray, ...]:
    """Corners (M, 2) [m] of convex shapely polygons, counter-clockwise."""
    import shapely

    return tuple(shapely.get_coordinates(area)[:-1] for area in shapely.orient_polygons(areas))


# --- the search ------------------------------------------------------------------------------------


def smallest_shape(
    deviations: Deviations, products: FloatArray, leave: float, start: Shape | None = None
) -> Shape:
    """The shape of the least volume that a share ``leave`` of the flights of ``products`` leave.

    The search begins at ellipses and at a fixed buffer, or at ``start`` alone.
    """
    from scipy.optimize import minimize

    allowed = max(1, int(leave * products.shape[2]))
    worst = worst_flights(deviations, products, max(WORST, 3.0 * leave))

    def cost(values: FloatArray) -> float:
        import shapely

        shape = Shape.of(values)
        size = np.partition(deviations.sizes(shape, worst), -allowed - 1)[-allowed - 1]
        return math.log(float(shapely.area(deviations.hulls(shape, float(size))).sum()))

    best: Any = None
    for at in STARTS if start is None else (start.values(),):
        options: Any = {"maxfev": SEARCHES, "xatol": 1e-2, "fatol": 1e-4, "initial_simplex": _simplex(at)}
        found = minimize(cost, np.array(at), method="Nelder-Mead", options=options)
        best = found if best is None or found.fun < best.fun else best
    return Shape.of(best.x)


def _simplex(start: Sequence[float]) -> FloatArray:
    """The first simplex (6, 5) of the search."""
    steps = np.diag([0.4, 0.4, 0.3, 0.3, 0.15])
    steps[1:3] *= np.where(np.array(start[1:3]) > 0.5, -1.0, 1.0)[:, None]
    return np.vstack([np.array(start), np.array(start) + steps])


def worst_flights(deviations: Deviations, products: FloatArray, share: float) -> FloatArray:
    """Flights that deviate most, by ellipses or by circles: only they decide which volumes are left."""
    if share >= 0.5:
        return products
    count = int(share * products.shape[2]) + 2
    far = [deviations.sizes(shape, products) for shape in (Shape(), Shape(2.0), Shape(1.0, 0.99, 1.0))]
    rows = np.unique(np.concatenate([np.argpartition(size, -count)[-count:] for size in far]))
    return np.ascontiguousarray(products[:, :, rows])


# --- the size --------------------------------------------------------------------------------------


def least_size(sample: FlightSample, sizes: FloatArray, leave: float) -> float | None:
    """The least size that flights of ``sizes`` (n,) exceed with a probability of at most ``leave``.

    The upper end of the 95 % interval of the rate is at most ``leave``. None if no size in the sample is
    large enough.
    """
    order = np.sort(sizes)
    beyond = 0 if sample.weight is None else LEFT_LEAST  # without one that leaves, any weight is possible
    low, high = -1, len(order) - 1 - beyond  # the size order[high] keeps the limit
    if sample.rate(sizes > order[high]).high > leave:
        return None
    while high - low > 1:
        middle = (low + high) // 2
        keeps = sample.rate(sizes > order[middle]).high <= leave
        low, high = (low, middle) if keeps else (middle, high)
    return float(order[high])


def least_volumes(deviations: Deviations, shape: Shape, sample: FlightSample, leave: float) -> Volumes | None:
    """The least volumes of a ``shape`` that flights leave with a probability of at most ``leave``.

    A polygon holds more than its ellipses, so that it may be smaller than they are.
    """
    sizes = deviations.sizes(shape, deviations.products(sample.x))
    size = least_size(sample, sizes, leave)
    if size is None:
        return None
    far = sizes > TIGHTEST * size
    low, high = TIGHTEST, 1.0
    for _ in range(SHRINKS):
        share = 0.5 * (low + high)
        left = np.zeros(len(sizes), bool)
        left[far] = deviations.volumes(shape, share * size).left_by(sample.x[far])
        low, high = (low, share) if sample.rate(left).high <= leave else (share, high)
    return deviations.volumes(shape, high * size)


# --- the fixed buffer ------------------------------------------------------------------------------


def buffer_distances(route: FloatArray, x: FloatArray) -> FloatArray:
    """Radius (n,) [m] of the fixed buffer about the legs of ``route`` (T+1, 2) that holds each flight."""
    far = np.zeros(len(x))
    for k, leg in enumerate(pairwise(route)):
        for t in (k, k + 1):
            far = np.maximum(far, distance_to(leg, x[:, t]))
    return far


def distance_to(leg: tuple[FloatArray, FloatArray], points: FloatArray) -> FloatArray:
    """Distance [m] of ``points`` (n, 2) from a straight ``leg``."""
    start, along = leg[0], leg[1] - leg[0]
    length = float(along @ along)
    share = (
        np.clip((points - start) @ along / length, 0.0, 1.0) if length > STILL**2 else np.zeros(len(points))
    )
    return np.asarray(np.linalg.norm(points - start - share[:, None] * along, axis=1), float)


def buffer_volume_time(route: FloatArray, radius: float, dt: float) -> float:
    """Area times duration [m² s] of buffers of ``radius`` [m] about the legs of ``route`` (T+1, 2)."""
    legs = np.linalg.norm(np.diff(route, axis=0), axis=1)
    return float(dt * (2.0 * radius * legs + math.pi * radius**2).sum())


def exit_steps(deviations: Deviations, shape: Shape, size: float, x: FloatArray) -> Iterator[tuple[int, int]]:
    """Row and step at which each flight ``x`` (n, T+1, 2) leaves the ellipses of ``size`` first."""
    beyond = ellipse_sizes(x, deviations.mean, deviations.ellipses(shape)) > size
    for row in np.flatnonzero(beyond.any(axis=1)).tolist():
        yield row, int(beyond[row].argmax())
