"""What happens to flights between two fixes: the linear law over several steps, the same for all of them.

A move is e' = A e + G θ + n, θ' = R θ + ζ (:class:`~pareto_ltl.kernels.pilots.Moves`).
"""

from __future__ import annotations

from pareto_ltl.kernels.interpolation import F32, dot
from pareto_ltl.kernels.pilots import Beliefs, Moves
from pareto_ltl.support.arrays import Float32Array, FloatArray
from typed_kernels.jit import kernel, vector


@kernel
def stay(moves: Moves, k: int) -> None:
    """Let ``k`` be the move of no step."""
    modes = moves.kept.shape[1]
    for r in range(2):
        for c in range(2):
            moves.turn[k, r, c], moves.noise[k, r, c] = 1.0 if r == c else 0.0, 0.0
        for j in range(2 * modes):
            moves.push[k, r, j], moves.mixed[k, r, j] = F32(0.0), F32(0.0)
    for m in range(modes):
        moves.kept[k, m] = F32(1.0)
    moves.end[k] = k


@vector
def lengthen(moves: Moves, k: int, steps: Moves, last: int, scratch: FloatArray) -> None:
    """Follow the move ``k`` by the step that begins at ``last``; ``scratch`` (2, 2P)."""
    modes = moves.kept.shape[1]
    F, push, mixed, kept = steps.turn[last], moves.push[k], moves.mixed[k], moves.kept[k]
    step, fade = steps.push[last], steps.kept[last]
    a, b, c, d = F32(F[0, 0]), F32(F[0, 1]), F32(F[1, 0]), F32(F[1, 1])
    noise, turn = moves.noise[k], moves.turn[k]
    for r in range(2):
        for half in range(2):
            for m in range(modes):
                scratch[r, half * modes + m] = step[r, half * modes + m] * (F32(1.0) - kept[m] * kept[m])
    xx, xy, yx, yy = noise[0, 0], noise[0, 1], noise[1, 0], noise[1, 1]
    w00, w01 = F[0, 0] * xx + F[0, 1] * yx, F[0, 0] * xy + F[0, 1] * yy
    w10, w11 = F[1, 0] * xx + F[1, 1] * yx, F[1, 0] * xy + F[1, 1] * yy
    # What θ has lost since the move began acts on e through the step, and is correlated with e before it.
    p00, p01 = dot(mixed[0], step[0]), dot(mixed[0], step[1])
    p10, p11 = dot(mixed[1], step[0]), dot(mixed[1], step[1])
    q00, q01 = F[0, 0] * p00 + F[0, 1] * p10, F[0, 0] * p01 + F[0, 1] * p11
    q10, q11 = F[1, 0] * p00 + F[1, 1] * p10, F[1, 0] * p01 + F[1, 1] * p11
    fresh = dot(scratch[0], step[1])
    noise[0, 0] = w00 * F[0, 0] + w01 * F[0, 1] + 2.0 * q00 + dot(scratch[0], step[0])
    noise[0, 1] = w00 * F[1, 0] + w01 * F[1, 1] + q01 + q10 + fresh
    noise[1, 0] = noise[0, 1]
    noise[1, 1] = w10 * F[1, 0] + w11 * F[1, 1] + 2.0 * q11 + dot(scratch[1], step[1])
    for r in range(2):
        noise[r, r] += steps.noise[last, r, r]
        x, y = turn[0, r], turn[1, r]
        turn[0, r], turn[1, r] = F[0, 0] * x + F[0, 1] * y, F[1, 0] * x + F[1, 1] * y
    for half in range(2):
        for m in range(modes):
            j = half * modes + m
            x, y = push[0, j], push[1, j]
            push[0, j] = a * x + b * y + step[0, j] * kept[m]
            push[1, j] = c * x + d * y + step[1, j] * kept[m]
            x, y = mixed[0, j], mixed[1, j]
            mixed[0, j] = fade[m] * (a * x + b * y + scratch[0, j])
            mixed[1, j] = fade[m] * (c * x + d * y + scratch[1, j])
    for m in range(modes):
        kept[m] *= fade[m]
    moves.end[k] = last + 1


@vector
def times_theta(push: Float32Array, known: FloatArray, rank: int, product: FloatArray) -> None:
    """Write ``push`` (2, 2P) Cov(θ̃) to ``product`` (2, 2P); Cov(θ̃) = I - K'K, K = ``known[:rank]``.

    K has 64 bits: where little is unknown, I and K'K are nearly equal.
    """
    both = product.shape[1]
    for j in range(both):
        product[0, j], product[1, j] = push[0, j], push[1, j]
    for i in range(rank):
        row = known[i]
        x, y = dot(push[0], row), dot(push[1], row)
        for j in range(both):
            product[0, j] -= x * row[j]
            product[1, j] -= y * row[j]


@vector
def move_belief(own: Beliefs, row: int, moves: Moves, k: int) -> None:
    """The covariances of ``row`` after the move ``k``; ``before``, ``across``, ``lagged`` are with its begin.

    Eq. (M25) of docs/mathematics.md.
    """
    A, push, mixed, kept = moves.turn[k], moves.push[k], moves.mixed[k], moves.kept[k]
    cov, cross, lagged = own.cov[row], own.cross[row], own.lagged[row]
    times_theta(push, own.known[row], own.rank[row], own.push)
    a, b, c, d = F32(A[0, 0]), F32(A[0, 1]), F32(A[1, 0]), F32(A[1, 1])
    # g = G Cov(θ, e), t = G Cov(θ) G'
    e00, e01, e11 = cov[0, 0], cov[0, 1], cov[1, 1]
    g00, g01 = dot(push[0], cross[0]), dot(push[0], cross[1])
    g10, g11 = dot(push[1], cross[0]), dot(push[1], cross[1])
    t00, t01, t11 = dot(push[0], own.push[0]), dot(push[0], own.push[1]), dot(push[1], own.push[1])
    before, across = own.before[row], own.across[row]
    before[0, 0], before[0, 1], before[1, 0], before[1, 1] = e00, e01, e01, e11
    across[0, 0], across[0, 1] = A[0, 0] * e00 + A[0, 1] * e01 + g00, A[0, 0] * e01 + A[0, 1] * e11 + g01
    across[1, 0], across[1, 1] = A[1, 0] * e00 + A[1, 1] * e01 + g10, A[1, 0] * e01 + A[1, 1] * e11 + g11
    # Cov(e') = Cov(e', e) A' + h + Cov(n), with h = (A Cov(e, θ) + G Cov(θ)) G'
    h00, h01 = A[0, 0] * g00 + A[0, 1] * g01 + t00, A[0, 0] * g10 + A[0, 1] * g11 + t01
    h11 = A[1, 0] * g10 + A[1, 1] * g11 + t11
    cov[0, 0] = across[0, 0] * A[0, 0] + across[0, 1] * A[0, 1] + h00 + moves.noise[k, 0, 0]
    cov[0, 1] = across[0, 0] * A[1, 0] + across[0, 1] * A[1, 1] + h01 + moves.noise[k, 0, 1]
    cov[1, 1] = across[1, 0] * A[1, 0] + across[1, 1] * A[1, 1] + h11 + moves.noise[k, 1, 1]
    cov[1, 0] = cov[0, 1]
    for half in range(2):
        for m in range(len(kept)):
            j = half * len(kept) + m
            x, y = cross[0, j], cross[1, j]
            lagged[0, j], lagged[1, j] = kept[m] * x, kept[m] * y
            cross[0, j] = kept[m] * (a * x + b * y + own.push[0, j]) + mixed[0, j]
            cross[1, j] = kept[m] * (c * x + d * y + own.push[1, j]) + mixed[1, j]


@vector
def fade_theta(known: FloatArray, rank: int, kept: Float32Array) -> None:
    """Cov(θ̃) <- ρ Cov(θ̃) ρ + I - ρ², which is I - (Kρ)'(Kρ); K = ``known[:rank]``, ``kept`` (P,) = ρ."""
    modes = len(kept)
    for i in range(rank):
        for half in range(2):
            for m in range(modes):
                known[i, half * modes + m] *= kept[m]


@kernel
def changes(kept: Float32Array) -> bool:
    """Whether θ of any mode changes at a step; ``kept`` (P,) = ρ."""
    least = 1.0
    for m in range(len(kept)):
        least = min(least, kept[m])
    return least < 1.0
