"""Gaussian processes over wind readings: one for each time and component."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pareto_ltl.settings import WindConfig
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.cores import cores
from pareto_ltl.wind.records import WindObservations

# Start of the search for hyperparameters, in standardised units. For readings over the contiguous US they are
# a length of 470 km, an amplitude of 3 m/s and a noise of 1.5 m/s.
START_LENGTH, START_AMPLITUDE, START_NOISE = 0.45, 0.9, 0.45
NORMAL_QUANTILE_95 = (
    1.6448536269514722  # 90 % of a normal variable lie within ± this many standard deviations
)
RELATIVE_JITTER = 1e-10  # added noise variance over amplitude², for the Cholesky factor


class Hyper(NamedTuple):
    """Hyperparameters of one process: prior mean, amplitude α and noise σ [m/s], length scale ℓ [m]."""

    mean: float
    amplitude: float
    length: float
    noise: float


@dataclass(frozen=True, slots=True)
class WindPosterior:
    """Gaussian processes conditioned on readings, independent over times and components.

    Attributes
    ----------
    times : (K,) float
        [s since time_zero]
    points, winds : tuple of (n_k, 2) float
        Positions [m] and winds [m/s] of the readings.
    kernel : str
        ``matern32`` or ``rbf``.
    hyper : tuple of K pairs of Hyper
        For the x and y component at each time.
    score : mapping of str to float
        ``gp_z_sd`` and ``gp_coverage_90`` of readings that a first fit did not use.
    """

    times: FloatArray
    points: tuple[FloatArray, ...]
    winds: tuple[FloatArray, ...]
    kernel: str
    hyper: tuple[tuple[Hyper, Hyper], ...]
    score: dict[str, float]

    @property
    def gust_var(self) -> FloatArray:
        """Variance σ² of the white part, shape (K, 2) [m²/s²]."""
        return np.array([[h.noise**2 for h in pair] for pair in self.hyper])

    def at(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Mean [m/s] and latent variance [m²/s²] at ``points`` (P, 2) [m], both of shape (K, P, 2)."""
        mean = np.empty((len(self.times), len(points), 2))
        var = np.empty_like(mean)
        for k, pair in enumerate(self.hyper):
            near = pairwise_distances(self.points[k], self.points[k])
            cross = pairwise_distances(self.points[k], points)
            for c, h in enumerate(pair):
                mean[k, :, c], var[k, :, c] = _condition_gp(self.kernel, h, near, cross, self.winds[k][:, c])
        return mean, var


def fit_posterior(cfg: WindConfig, observations: WindObservations) -> WindPosterior:
    """Condition a Gaussian process on the readings of every time and component.

    A reading is the sum of a constant, a Gaussian process and noise (Rasmussen and Williams, Gaussian
    Processes for Machine Learning, 2006, chapter 2)::

        w_i = m + f(x_i) + e_i,  e_i ~ N(0, σ²),  r = ‖x - x'‖ / ℓ

        matern32:  k(x, x') = α² (1 + √3 r) exp(-√3 r)
        rbf:       k(x, x') = α² exp(-r² / 2)

    m is the mean of the readings. α, ℓ and σ >= ``cfg.noise_min`` maximise the marginal likelihood; ℓ is the
    same in all directions. The score is that of a first fit without a share ``cfg.holdout`` of the readings.
    """
    from joblib import Parallel, delayed
    from sklearn.exceptions import ConvergenceWarning
    from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

    jobs = [
        (cfg, k, p, w) for k, (p, w) in enumerate(zip(observations.points, observations.winds, strict=True))
    ]
    # One BLAS thread per job: the matrices have about 120 rows, and more threads compete for the cores.
    with warnings.catch_warnings(), threadpool_limits(1):
        warnings.simplefilter("ignore", ConvergenceWarning)  # a hyperparameter at its bound is valid
        fits = Parallel(n_jobs=min(len(jobs), cores()), prefer="threads")(
            delayed(_fit_slot)(*j) for j in jobs
        )
    z = np.concatenate([scores for _, scores in fits])
    score = {
        "gp_z_sd": float(np.sqrt(np.mean(z**2))),
        "gp_coverage_90": float(np.mean(np.abs(z) <= NORMAL_QUANTILE_95)),
    }
    return WindPosterior(
        times=observations.times,
        points=observations.points,
        winds=observations.winds,
        kernel=cfg.kernel,
        hyper=tuple(hyper for hyper, _ in fits),
        score=score,
    )


def _fit_slot(
    cfg: WindConfig, slot: int, points: FloatArray, winds: FloatArray
) -> tuple[tuple[Hyper, Hyper], FloatArray]:
    """Hyperparameters of both components at one time, and z-scores of the readings held out."""
    shuffled = np.random.default_rng(slot).permutation(len(points))  # another share at every time
    count = min(max(1, round(cfg.holdout * len(points))), len(points) - 3)
    out, kept = shuffled[:count], shuffled[count:]
    near, cross = (
        pairwise_distances(points[kept], points[kept]),
        pairwise_distances(points[kept], points[out]),
    )
    pair, scores = [], []
    for wind in winds.T:
        trial = _maximise_likelihood(cfg, points[kept], wind[kept], None)
        mean, var = _condition_gp(cfg.kernel, trial, near, cross, wind[kept])
        scores.append((wind[out] - mean) / np.sqrt(var + trial.noise**2))
        pair.append(_maximise_likelihood(cfg, points, wind, trial))
    return (pair[0], pair[1]), np.concatenate(scores)


def _maximise_likelihood(cfg: WindConfig, points: FloatArray, wind: FloatArray, start: Hyper | None) -> Hyper:
    """Maximum-likelihood hyperparameters of one component, in SI units; the search begins at ``start``."""
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel, Matern, WhiteKernel

    mean, scale = float(wind.mean()), max(float(wind.std()), cfg.noise_min)
    reach = float(np.sqrt(np.var(points, axis=0).mean()))  # > 0: positions differ
    x, y = (points - points.mean(axis=0)) / reach, (wind - mean) / scale
    shortest = max(0.02, 0.5 * _typical_gap(x))
    bounds = [(1e-2, 1e1), (shortest, 1e1), (cfg.noise_min / scale, 3.0)]
    first = (START_AMPLITUDE, START_LENGTH, START_NOISE)
    if start is not None:
        first = (start.amplitude / scale, start.length / reach, start.noise / scale)
    (a, la), (ell, ll), (s, ls) = ((float(np.clip(f, *b)), b) for f, b in zip(first, bounds, strict=True))
    smooth = Matern(ell, ll, nu=1.5) if cfg.kernel == "matern32" else RBF(ell, ll)
    kernel = ConstantKernel(a**2, _squared_bounds(la)) * smooth + WhiteKernel(s**2, _squared_bounds(ls))
    model = GaussianProcessRegressor(kernel, alpha=RELATIVE_JITTER).fit(x, y)
    alpha2, length, sigma2 = np.exp(model.kernel_.theta)
    return Hyper(mean, float(np.sqrt(alpha2)) * scale, float(length) * reach, float(np.sqrt(sigma2)) * scale)


def _condition_gp(
    kernel: str, h: Hyper, near: FloatArray, cross: FloatArray, wind: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Posterior mean and latent variance (P,) from distances ``near`` (n, n) and ``cross`` (n, P) [m].

    Rasmussen and Williams (2006), Algorithm 2.1::

        L L'  = K + σ² I
        μ     = m + k*' (L L')⁻¹ (w - m)
        Var f = α² - ‖L⁻¹ k*‖²
    """
    from scipy.linalg import cho_solve, solve_triangular

    k = CORRELATIONS[kernel]
    K = h.amplitude**2 * k(near / h.length)
    K[np.diag_indices_from(K)] += h.noise**2 + RELATIVE_JITTER * h.amplitude**2
    L = np.linalg.cholesky(K)
    k_star = h.amplitude**2 * k(cross / h.length)
    mean = h.mean + k_star.T @ cho_solve((L, True), wind - h.mean)
    v = solve_triangular(L, k_star, lower=True)
    return mean, np.maximum(h.amplitude**2 - np.einsum("ij,ij->j", v, v), 0.0)


def _matern32(r: FloatArray) -> FloatArray:
    s = np.sqrt(3.0) * r
    rho: FloatArray = (1.0 + s) * np.exp(-s)
    return rho


def _rbf(r: FloatArray) -> FloatArray:
    rho: FloatArray = np.exp(-0.5 * r**2)
    return rho


CORRELATIONS: dict[str, Callable[[FloatArray], FloatArray]] = {"matern32": _matern32, "rbf": _rbf}


def pairwise_distances(a: FloatArray, b: FloatArray) -> FloatArray:
    """Distances (n, m) between points ``a`` (n, 2) and ``b`` (m, 2)."""
    from scipy.spatial.distance import cdist

    between: FloatArray = cdist(a, b)
    return between


def _typical_gap(points: FloatArray) -> float:
    """Median distance to the nearest neighbour, below which no length scale can be resolved."""
    gaps = pairwise_distances(points, points)
    np.fill_diagonal(gaps, np.inf)
    return float(np.median(gaps.min(axis=1)))


def _squared_bounds(bounds: tuple[float, float]) -> tuple[float, float]:
    return bounds[0] ** 2, bounds[1] ** 2


__all__ = ["CORRELATIONS", "Hyper", "WindPosterior", "fit_posterior", "pairwise_distances"]
