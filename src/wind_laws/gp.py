"""Gaussian processes fitted to wind readings: one for each time and component, common hyperparameters."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from wind_laws.places import farthest_points, pairwise_distances, same_places
from wind_laws.records import PlacedReadings
from wind_laws.types import BoolArray, FloatArray, IntArray

# Start of the search for hyperparameters, in standardised units. For readings over the contiguous US these
# are a length of 550 km, an amplitude of 3.1 m/s and a noise of 0.6 m/s.
START_LENGTH, START_AMPLITUDE, START_NOISE = 0.5, 1.0, 0.2
RELATIVE_JITTER = 1e-10  # added noise variance over amplitude², for the Cholesky factor
MAX_FITTED = 150  # readings per time to which hyperparameters are fitted; more change them little
MAX_TIMES = 30  # groups of times with the same places to which hyperparameters are fitted
MANY = 1000  # number of readings above which linear algebra uses all cores
MAX_PAIRS = 10**7  # of readings and points in one matrix: 80 MB
FACTOR_LENGTH = 250e3  # [m] over which squared residuals are averaged for the variance factor
# 90 % of a normal variable lie within ± this many standard deviations
NORMAL_QUANTILE_95 = 1.6448536269514722
SCORES = ("gp_z_sd", "gp_coverage_90", "gp_nlpd")  # of held-out readings
LEAST_SCORED = 4  # smallest number of places for the score, and for the fit
FACTOR_PRIOR = 0.5  # weight of the overall mean squared residual in that average, in readings


class FitOptions(NamedTuple):
    """What a fit can be told.

    Attributes
    ----------
    kernel : str
        ``matern12``, ``matern32`` or ``rbf``.
    noise_min : float
        Lower bound of the standard deviation of white noise [m/s].
    holdout : float
        Share of the places that are held out to score the fit.
    energy : float
        Share of the variance of the error that modes carry.
    modes_max : int
        Largest number of modes of a component.
    """

    kernel: str = "matern12"
    noise_min: float = 0.3
    holdout: float = 0.2
    energy: float = 0.99
    modes_max: int = 64


class Hyper(NamedTuple):
    """Hyperparameters of all processes: amplitude α and noise σ [m/s], length scale ℓ [m]."""

    amplitude: float
    length: float
    noise: float


@dataclass(frozen=True, slots=True)
class WindPosterior:
    """Gaussian processes conditioned on readings, independent over times and components.

    Attributes
    ----------
    times : (K,) float
        Times of the readings [s].
    points, winds : tuple of (n_k, 2) float
        Positions [m] and winds [m/s] of the readings.
    kernel : str
        ``matern12``, ``matern32`` or ``rbf``.
    hyper : Hyper
        Hyperparameters that all times and components have in common.
    means : (K, 2) float
        Prior mean of each time and component [m/s].
    score : mapping of str to float
        ``gp_z_sd``, ``gp_coverage_90`` and ``gp_nlpd`` of readings that were held out of a first fit.
    residuals : tuple of (n_k, 2) float
        Standardised leave-one-out residuals of the readings.
    anchors : (A, 2) float, squares : (A,) float
        Places of readings [m], and the mean squared standardised residual at each.
    """

    times: FloatArray
    points: tuple[FloatArray, ...]
    winds: tuple[FloatArray, ...]
    kernel: str
    hyper: Hyper
    means: FloatArray
    score: dict[str, float]
    residuals: tuple[FloatArray, ...]
    anchors: FloatArray
    squares: FloatArray

    @property
    def gust_var(self) -> FloatArray:
        """Variance σ² of the white part, shape (K, 2) [m²/s²]."""
        return np.full(self.means.shape, self.hyper.noise**2)

    def at(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Mean [m/s] and latent variance [m²/s²] at ``points`` (P, 2) [m], both of shape (K, P, 2).

        The latent variance includes the variance factor s²: (v + σ²) s² - σ², at least 0.
        """
        mean = np.empty((len(self.times), len(points), 2))
        var, factor = np.empty_like(mean), self.variance_factor(points)
        for slots in same_places(self.points):
            mean[slots], var[slots] = self.slots_at(slots, points, factor)
        return mean, var

    def slots_at(
        self, slots: IntArray, points: FloatArray, factor: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Mean (n, P, 2) and latent variance (P, 1) at n times with readings at the same places.

        ``factor`` (P,) is the variance factor at ``points``.
        """
        winds, prior = np.stack([self.winds[k] for k in slots], axis=1), self.means[slots]
        found, v = _condition_gp(self.kernel, self.hyper, self.points[slots[0]], points, winds - prior)
        return (found + prior).transpose(1, 0, 2), scaled_variance(v, self.hyper.noise**2, factor)[:, None]

    def spread_out(self, members: Sequence[FloatArray], points: FloatArray) -> FloatArray:
        """Deviations of the members of an ensemble at ``points`` (P, 2) [m], shape (K, P, 2, M) [m/s].

        ``members`` has the deviations at the readings, (n_k, 2, M) for each time; they are interpolated with
        the weights of the posterior mean. M = 0 if ``members`` is empty.
        """
        if not members:
            return np.zeros((len(self.times), len(points), 2, 0))
        pairs = zip(self.points, members, strict=True)
        return np.stack([_condition_gp(self.kernel, self.hyper, own, points, d)[0] for own, d in pairs])

    def variance_factor(self, points: FloatArray) -> FloatArray:
        """s² at ``points`` (P, 2) [m], shape (P,): local error variance relative to the kernel::

            s²(x) = (Σ_a g_a(x) z_a² + n z̄²) / (Σ_a g_a(x) + n),    g_a(x) = exp(-‖x - x_a‖² / 2 (250 km)²)

        where z_a² are the squared leave-one-out residuals of the readings, z̄² is their mean, and n = 0.5.

        Eq. (M9) of docs/mathematics.md.
        """
        anchors, squares = self.anchors, self.squares
        total, weight = (np.full(len(points), FACTOR_PRIOR * n) for n in (squares.mean(), 1.0))
        for rows in np.array_split(np.arange(len(anchors)), max(1, len(anchors) * len(points) // MAX_PAIRS)):
            g = np.exp(-0.5 * (pairwise_distances(anchors[rows], points) / FACTOR_LENGTH) ** 2)
            total, weight = total + squares[rows] @ g, weight + g.sum(axis=0)
        return np.asarray(total / weight, float)


def fit_posterior(
    options: FitOptions, observations: PlacedReadings, bounds: FloatArray | None = None
) -> WindPosterior:
    """Condition a Gaussian process on the readings of every time and component.

    A reading is the sum of a constant, a Gaussian process and noise (Rasmussen and Williams, Gaussian
    Processes for Machine Learning, 2006, chapter 2)::

        w_i = m + f(x_i) + e_i,  e_i ~ N(0, σ²),  r = ‖x - x'‖ / ℓ

        matern12:  k(x, x') = α² exp(-r)
        matern32:  k(x, x') = α² (1 + √3 r) exp(-√3 r)
        rbf:       k(x, x') = α² exp(-r² / 2)

    m is the mean of the readings of a time and component. α, ℓ and σ >= ``noise_min`` are common to all times
    and components and maximise the product of the likelihoods; fitted to single times, they vary by a factor
    of 4. The score comes from a first fit without a share ``holdout`` of the places (:func:`held_out`).

    Negative log predictive density per value, on withheld nodes of GFS fields
    (``benchmarks/compare_wind_fits.py``): 1.92 with matern32 fitted at each time, 1.89 with matern12 and
    common hyperparameters, 1.78 if the variance factor is added.

    Eq. (M5) of docs/mathematics.md.

    Parameters
    ----------
    bounds : (2, 2) float, optional
        South-west and north-east corner of the region where the fit is scored [m].
    """
    from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

    largest = max(len(points) for points in observations.points)
    with threadpool_limits(1 if largest <= MANY else None):  # threads of small matrices compete for the cores
        out = held_out(options, observations, bounds)
        start, score = None, dict.fromkeys(SCORES, np.nan)
        if out is not None:
            trial = _fitted(options, observations, [~mask for mask in out], None)
            start, score = trial.hyper, score_of(trial, observations, out)
        everything = [np.ones(len(points), bool) for points in observations.points]
        posterior = _fitted(options, observations, everything, start)
    return replace(posterior, score=score)


# --- scores of readings that a fit did not use ----------------------------------------------


def held_out(options: FitOptions, seen: PlacedReadings, bounds: FloatArray | None) -> list[BoolArray] | None:
    """Masks of the readings that are held out for the score; None if there are too few readings.

    They are those at a random share ``holdout`` of the places in ``bounds`` or, if these are few, of all
    places.
    """
    places = np.unique(np.concatenate(seen.points), axis=0)
    near = places
    if bounds is not None:
        inside = places[((places >= bounds[0]) & (places <= bounds[1])).all(axis=1)]
        near = inside if len(inside) >= LEAST_SCORED / options.holdout else places
    count = max(1, round(options.holdout * len(near)))
    out = near[np.random.default_rng(0).permutation(len(near))[:count]]
    masks = [np.isin(p[:, 0] + 1j * p[:, 1], out[:, 0] + 1j * out[:, 1]) for p in seen.points]
    if count < LEAST_SCORED or any((~mask).sum() < LEAST_SCORED for mask in masks):
        return None
    return masks


def score_of(fit: WindPosterior, seen: PlacedReadings, out: Sequence[BoolArray]) -> dict[str, float]:
    """Scores of the predictions of the readings ``out`` (a mask for each time) by a fit without them.

    ``gp_z_sd``: root mean square of z-scores; ``gp_coverage_90``: share within 90 % intervals; ``gp_nlpd``:
    mean negative log predictive density.
    """
    z: list[FloatArray] = []
    log_sd: list[FloatArray] = []
    for slots in same_places(seen.points):
        places = seen.points[slots[0]][out[slots[0]]]
        if not len(places):
            continue
        mean, var = fit.slots_at(slots, places, fit.variance_factor(places))
        for i, k in enumerate(slots.tolist()):
            sd = np.sqrt(var + fit.gust_var[k])
            z.append(((seen.winds[k][out[k]] - mean[i]) / sd).ravel())
            log_sd.append(np.log(sd).ravel())
    scores = np.concatenate(z)
    z_sd = np.sqrt(np.mean(scores**2))
    coverage = np.mean(np.abs(scores) <= NORMAL_QUANTILE_95)
    nlpd = np.mean(0.5 * scores**2 + np.concatenate(log_sd)) + 0.5 * np.log(2 * np.pi)
    return dict(zip(SCORES, map(float, (z_sd, coverage, nlpd)), strict=True))


# --- hyperparameters --------------------------------------------------------------------------


def _fitted(
    options: FitOptions, seen: PlacedReadings, kept: Sequence[BoolArray], start: Hyper | None
) -> WindPosterior:
    """The posterior of the readings ``kept`` (a mask for each time), with hyperparameters fitted to them."""
    points = tuple(p[mask] for p, mask in zip(seen.points, kept, strict=True))
    winds = tuple(w[mask] for w, mask in zip(seen.winds, kept, strict=True))
    hyper = maximise_likelihood(options, points, winds, start)
    means = np.stack([w.mean(axis=0) for w in winds])
    residuals = leave_one_out(options.kernel, points, winds, hyper, means)
    anchors, squares = squared_residuals(points, residuals)
    return WindPosterior(
        seen.times, points, winds, options.kernel, hyper, means, {}, residuals, anchors, squares
    )


def maximise_likelihood(
    options: FitOptions, points: Sequence[FloatArray], winds: Sequence[FloatArray], start: Hyper | None = None
) -> Hyper:
    """Maximum-likelihood hyperparameters, common to times and components.

    Times with readings at the same places have one Cholesky factor. If there are more than ``MAX_TIMES``
    groups of such times, an evenly spread selection is used. The results have four significant digits.

    Eq. (M6) of docs/mathematics.md.
    """
    from scipy.optimize import minimize

    together = same_places(points)
    used = np.unique(np.linspace(0, len(together) - 1, min(MAX_TIMES, len(together))).round().astype(int))
    groups = [_fit_group(points, winds, together[g]) for g in used]
    deviations = np.concatenate([y.ravel() for _, y in groups])
    scale = max(float(np.sqrt(np.mean(deviations**2))), options.noise_min)
    everywhere = np.concatenate([x for x, _ in groups])
    reach = float(np.sqrt(np.var(everywhere, axis=0).mean()))  # > 0: positions differ
    shortest = max(0.02, 0.5 * min(_typical_gap(x) for x, _ in groups) / reach)
    bounds = [(1e-2, 1e1), (shortest, 1e1), (options.noise_min / scale, 3.0)]
    first = (START_AMPLITUDE, START_LENGTH, START_NOISE)
    if start is not None:
        first = (start.amplitude / scale, start.length / reach, start.noise / scale)
    models = [_likelihood_model(options.kernel, x / reach, y / scale) for x, y in groups]

    def loss(theta: FloatArray) -> tuple[float, FloatArray]:
        values = [model.log_marginal_likelihood(theta, True, clone_kernel=False) for model in models]
        return -float(sum(v for v, _ in values)), -np.sum([g for _, g in values], axis=0)

    limits = 2.0 * np.log(np.array(bounds))
    limits[1] /= 2.0  # scikit-learn has log α², log ℓ, log σ²
    begin = np.log([f if i == 1 else f**2 for i, f in enumerate(first)])
    found = minimize(loss, np.clip(begin, *limits.T), jac=True, method="L-BFGS-B", bounds=limits)
    alpha2, length, sigma2 = np.exp(found.x)
    noise = max(_significant(np.sqrt(sigma2) * scale), options.noise_min)
    return Hyper(_significant(np.sqrt(alpha2) * scale), _significant(length * reach), noise)


def _significant(value: float) -> float:
    """``value`` to four significant digits.

    Within the tolerance of the search, the result depends on rounding in BLAS. The likelihoods of such values
    do not differ, and results of different processors should not either.
    """
    return float(f"{value:.3e}")


def _fit_group(
    points: Sequence[FloatArray], winds: Sequence[FloatArray], slots: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Places (n, 2) of K' times, thinned evenly, and all deviations from the means (n, 2 K')."""
    places = points[slots[0]]
    chosen = np.arange(len(places))
    if len(places) > MAX_FITTED:
        first = int(np.argmin(((places - places.mean(axis=0)) ** 2).sum(axis=1)))
        chosen = np.sort(farthest_points(places, MAX_FITTED, first))
    return places[chosen], np.column_stack([winds[k][chosen] - winds[k].mean(axis=0) for k in slots])


def _likelihood_model(kernel: str, x: FloatArray, y: FloatArray) -> Any:
    """The process of scikit-learn with its data; its likelihood is the product over the columns of ``y``."""
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel, Matern, WhiteKernel

    smooth = {"matern12": Matern(nu=0.5), "matern32": Matern(nu=1.5), "rbf": RBF()}[kernel]
    whole = ConstantKernel() * smooth + WhiteKernel()
    return GaussianProcessRegressor(whole, alpha=RELATIVE_JITTER, optimizer=None).fit(x, y)


# --- conditioning -----------------------------------------------------------------------------


def _condition_gp(
    kernel: str, h: Hyper, readings: FloatArray, points: FloatArray, deviations: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Posterior mean (P, ...) of ``deviations`` (n, ...) from the prior mean, and latent variance (P,).

    At ``points`` (P, 2) from ``readings`` (n, 2) [m]; Rasmussen and Williams (2006), Algorithm 2.1::

        L L'  = K + σ² I
        μ     = k*' (L L')⁻¹ (w - m)
        Var f = α² - ‖L⁻¹ k*‖²

    Eq. (M7) of docs/mathematics.md.
    """
    from scipy.linalg import cho_solve, solve_triangular

    k, a2 = CORRELATIONS[kernel], h.amplitude**2
    L = np.linalg.cholesky(reading_covariance(kernel, h, readings))
    weights = cho_solve((L, True), deviations.reshape(len(readings), -1))
    mean, variance = np.empty((len(points), weights.shape[1])), np.empty(len(points))
    for rows in np.array_split(np.arange(len(points)), max(1, len(readings) * len(points) // MAX_PAIRS)):
        k_star = a2 * k(pairwise_distances(readings, points[rows]) / h.length)
        mean[rows] = k_star.T @ weights
        v = solve_triangular(L, k_star, lower=True, overwrite_b=True, check_finite=False)
        variance[rows] = np.maximum(a2 - np.einsum("ij,ij->j", v, v), 0.0)
    return mean.reshape(-1, *deviations.shape[1:]), variance


def reading_covariance(
    kernel: str, h: Hyper, places: FloatArray, jitter: float = RELATIVE_JITTER
) -> FloatArray:
    """K + σ² I (n, n) of readings at ``places`` (n, 2) [m²/s²]."""
    K = h.amplitude**2 * CORRELATIONS[kernel](pairwise_distances(places, places) / h.length)
    K[np.diag_indices_from(K)] += h.noise**2 + jitter * h.amplitude**2
    return np.asarray(K, float)


def _inverse(K: FloatArray) -> FloatArray:
    """K⁻¹ of a covariance; if it is large, from its Cholesky factor, which takes half the time."""
    if len(K) <= MANY:
        return np.asarray(np.linalg.inv(K), float)
    from scipy.linalg.lapack import dpotrf, dpotri

    lower, _ = dpotri(dpotrf(K, lower=True, overwrite_a=True)[0], lower=True, overwrite_c=True)
    return np.asarray(np.tril(lower) + np.tril(lower, -1).T, float)


def leave_one_out(
    kernel: str, points: Sequence[FloatArray], winds: Sequence[FloatArray], hyper: Hyper, means: FloatArray
) -> tuple[FloatArray, ...]:
    """Standardised leave-one-out residuals z of the readings of each time, (n_k, 2) each.

    Rasmussen and Williams (2006), Eqs. 5.10 to 5.12::

        r_i = [K⁻¹ (w - m)]_i / [K⁻¹]_ii,   Var r_i = 1 / [K⁻¹]_ii,   z_i = r_i / √(Var r_i)

    Times with readings at the same places have one K⁻¹.

    Eq. (M8) of docs/mathematics.md.
    """
    residuals: dict[int, FloatArray] = {}
    for slots in same_places(points):
        K_inv = _inverse(reading_covariance(kernel, hyper, points[slots[0]]))
        for k in slots.tolist():
            residuals[k] = K_inv @ (winds[k] - means[k]) / np.sqrt(np.diag(K_inv))[:, None]
    return tuple(residuals[k] for k in range(len(points)))


def squared_residuals(
    points: Sequence[FloatArray], residuals: Sequence[FloatArray]
) -> tuple[FloatArray, FloatArray]:
    """All places (A, 2) [m], and the mean of z² at each over times and components (A,)."""
    groups = same_places(points)
    squares = [(np.stack([residuals[k] for k in slots]) ** 2).mean(axis=(0, 2)) for slots in groups]
    return np.concatenate([points[slots[0]] for slots in groups]), np.concatenate(squares)


def scaled_variance(latent: FloatArray, noise: float, factor: FloatArray) -> FloatArray:
    """``factor`` (v + σ²) - σ² [m²/s²], at least 0, with v = ``latent`` and σ² = ``noise``.

    Only the latent variance is scaled, since the white part averages out along a way.

    Eq. (M9) of docs/mathematics.md.
    """
    return np.asarray(np.maximum(factor * (latent + noise) - noise, 0.0), float)


# --- kernels ----------------------------------------------------------------------------------


CORRELATIONS: dict[str, Callable[[FloatArray], FloatArray]] = {
    "matern12": lambda r: np.exp(-r),
    "matern32": lambda r: (1.0 + np.sqrt(3.0) * r) * np.exp(-np.sqrt(3.0) * r),
    "rbf": lambda r: np.exp(-0.5 * r**2),
}


def _typical_gap(points: FloatArray) -> float:
    """Median distance to the nearest neighbour [m]; shorter length scales cannot be resolved."""
    gaps = pairwise_distances(points, points)
    np.fill_diagonal(gaps, np.inf)
    return float(np.median(gaps.min(axis=1)))
