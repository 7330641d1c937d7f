"""The pilot that takes position fixes: a Kalman filter, and a control from what it knows.

A flight inside a landmark, at a step or between two, measures its position. Its filter, linear about the
planned means, estimates the deviation e and the coefficients θ of the wind field:

    e' = F e + dt (ψ' θ + white),    θ' = ρ θ + √(1 - ρ²) η,    y = s e_t + (1 - s) e_{t-1} + ν,

where s is the share of the step after which it leaves the landmark. The control is

    u = u_t - B⁻¹ (κ ê / dt + ψ' θ̂),    cut to [u_min, u_max].

The errors of the robot itself are further coefficients, with E_t beside ψ' and ρ = 1.

Covariances and gains of a filter depend on when and where it has measured, not on what. So flights with the
same history of fixes share them: a row of :class:`~pareto_ltl.kernels.pilots.Beliefs`. Rows are made when a
history first occurs, and used again when its last flight has measured anew. What happens between two fixes is
the same for all of them: :class:`~pareto_ltl.kernels.pilots.Moves`. A fix changes Cov(θ̃) by a matrix of rank
two, so a few rows describe it.

For a search, histories may be ``shared``: flights with their last two fixes at the same steps have one row,
which the first of them makes. Their filters are not optimal, but rows are few, and cost more than flights.
"""

from __future__ import annotations

import math

from pareto_ltl.kernels.data import Landmarks, Motion
from pareto_ltl.kernels.interpolation import F32, dot
from pareto_ltl.kernels.moves import changes, fade_theta, lengthen, move_belief, stay
from pareto_ltl.kernels.pilots import (
    SHARES,
    Beliefs,
    Moves,
    Navigator,
    begin_flights,
    command,
    observe,
    place_of_error,
    within_airspeed,
)
from pareto_ltl.support.arrays import Float32Array, FloatArray
from plane_kernels.types import Point
from typed_kernels.jit import implements, kernel, vector

# --- covariances of a history -----------------------------------------------------------------


@implements(begin_flights, Navigator)
def _begin_navigator(pilot: Navigator) -> None:
    for i in range(pilot.field.shape[0]):
        for j in range(pilot.field.shape[1]):
            pilot.field[i, j] = F32(0.0)
        for k in range(4):
            pilot.estimate[i, k] = 0.0
        pilot.history[i], pilot.fixed[i] = 0, False
    own, start = pilot.beliefs, pilot.law.start
    modes, half = pilot.law.psi.shape[2], pilot.moves.kept.shape[1]
    own.used[0], own.flights[0], own.step[0], own.rank[0] = 1, len(pilot.history), 0, 0
    for r in range(2):
        for c in range(2):
            own.cov[0, r, c] = pilot.law.variance if r == c else 0.0
            for q in range(start.shape[1]):
                own.cov[0, r, c] += start[r, q] * start[c, q]
            own.before[0, r, c], own.across[0, r, c] = own.cov[0, r, c], own.cov[0, r, c]
        for j in range(own.cross.shape[2]):
            own.cross[0, r, j], own.lagged[0, r, j] = F32(0.0), F32(0.0)
        for q in range(start.shape[1]):
            own.cross[0, r, place_of_error(q, modes, half)] = F32(start[r, q])
            own.lagged[0, r, place_of_error(q, modes, half)] = F32(start[r, q])
    own.last[0] = 0
    for group in range(len(own.asked)):
        own.asked[group] = -1
    stay(pilot.moves, 0)


@kernel
def group_at(pilot: Navigator, t: int, row: int) -> int:
    """The group of flights of ``row``, whose children are of step ``t`` afterwards.

    A group are the flights of one row or, where histories are ``shared``, with the last fix at one step, and
    as many fixes, up to three. A fix raises the rank by two.
    """
    own = pilot.beliefs
    group = 4 * own.last[row] + min(own.rank[row] // 2, 3) if pilot.shared else row
    if own.asked[group] != t:
        own.asked[group] = t
        for k in range(own.child.shape[1]):
            for part in range(SHARES):
                own.child[group, k, part] = -1
    return int(group)


@kernel
def fill_step(pilot: Navigator, dt: float, t: int) -> None:
    """Fill the move from step ``t`` - 1 to ``t``.

    Eq. (M25) of docs/mathematics.md.
    """
    law, steps, k = pilot.law, pilot.steps, t - 1
    modes = steps.kept.shape[1]
    for r in range(2):
        for c in range(2):
            steps.turn[k, r, c] = law.F[k, r, c]
            steps.noise[k, r, c] = dt * dt * law.white[k, r] if r == c else 0.0
        for j in range(2 * modes):
            steps.push[k, r, j], steps.mixed[k, r, j] = F32(0.0), F32(0.0)
        for m in range(law.psi.shape[2]):
            steps.push[k, r, r * modes + m] = F32(dt) * law.psi[k, r, m]
        for q in range(law.push.shape[2]):
            steps.push[k, r, place_of_error(q, law.psi.shape[2], modes)] = F32(dt * law.push[k, r, q])
    for m in range(modes):
        steps.kept[k, m] = law.kept[t, m]
    steps.end[k] = t


@kernel
def carry_belief(pilot: Navigator, t: int, row: int) -> None:
    """Bring the covariances of ``row`` to step ``t``: in one move to t - 1, and the step from there.

    Only rows whose flights measure are carried, and only their moves are lengthened.
    """
    own = pilot.beliefs
    if own.step[row] == t:
        return
    move_to(pilot, t - 1, row)
    move_by(own, row, pilot.steps, t - 1)
    own.step[row] = t


@kernel
def move_to(pilot: Navigator, t: int, row: int) -> None:
    """The covariances of ``row`` at step ``t``, in one move, which is lengthened as far."""
    own, moves, begin = pilot.beliefs, pilot.moves, pilot.beliefs.step[row]
    if begin == t:
        return
    while moves.end[begin] < t:
        lengthen(moves, begin, pilot.steps, moves.end[begin], own.push)
    move_by(own, row, moves, begin)


@kernel
def move_by(own: Beliefs, row: int, moves: Moves, k: int) -> None:
    """The covariances of ``row`` after the move ``k``."""
    move_belief(own, row, moves, k)
    if changes(moves.kept[k]):
        fade_theta(own.known[row], own.rank[row], moves.kept[k])


@vector
def copy_belief(own: Beliefs, row: int, target: int) -> None:
    """Copy what a fix changes from ``row`` to ``target``."""
    for r in range(2):
        for c in range(2):
            own.cov[target, r, c] = own.cov[row, r, c]
        for j in range(own.cross.shape[2]):
            own.cross[target, r, j] = own.cross[row, r, j]
    own.rank[target] = own.rank[row]
    for i in range(own.rank[row]):
        for j in range(own.known.shape[2]):
            own.known[target, i, j] = own.known[row, i, j]


@kernel
def learn_from_fix(own: Beliefs, row: int, target: int, s: float, error: FloatArray) -> None:
    """The covariances of ``target`` after a fix at the share ``s`` of the step that ends at ``row``.

    ``error`` (3,) is the covariance (xx, xy, yy) of the fix [m²].

    Eq. (M26) of docs/mathematics.md.
    """
    copy_belief(own, row, target)
    cov, before, across = own.cov[row], own.before[row], own.across[row]
    r, both = 1.0 - s, s * (1.0 - s)
    p = s * s * cov[0, 0] + r * r * before[0, 0] + 2.0 * both * across[0, 0] + error[0]
    q = s * s * cov[0, 1] + r * r * before[0, 1] + both * (across[0, 1] + across[1, 0]) + error[1]
    v = s * s * cov[1, 1] + r * r * before[1, 1] + 2.0 * both * across[1, 1] + error[2]
    det = p * v - q * q
    i00, i01, i11 = v / det, -q / det, p / det
    a00, a01 = s * cov[0, 0] + r * across[0, 0], s * cov[0, 1] + r * across[0, 1]
    a10, a11 = s * cov[1, 0] + r * across[1, 0], s * cov[1, 1] + r * across[1, 1]
    gain = own.gain[target]
    gain[0, 0], gain[0, 1] = a00 * i00 + a01 * i01, a00 * i01 + a01 * i11
    gain[1, 0], gain[1, 1] = a10 * i00 + a11 * i01, a10 * i01 + a11 * i11
    after = own.cov[target]
    after[0, 0] -= gain[0, 0] * a00 + gain[0, 1] * a01
    after[1, 1] -= gain[1, 0] * a10 + gain[1, 1] * a11
    mixed = gain[0, 0] * a10 + gain[0, 1] * a11
    after[0, 1] -= mixed
    after[1, 0] = after[0, 1]
    learn_field(own, row, target, s, (i00, i01, i11))
    # K gains the two rows L⁻¹ Cov(y, θ̃), with L the lower root of Cov(y).
    sd, rest = math.sqrt(p), math.sqrt(det / p)
    for j in range(own.push.shape[1]):
        own.push[0, j] /= sd
        own.push[1, j] = (own.push[1, j] - q / sd * own.push[0, j]) / rest
    for c in range(2):
        own.rank[target] = absorb(own.known[target], own.rank[target], own.push[c])


@vector
def learn_field(
    own: Beliefs, row: int, target: int, s: float, inverse: tuple[float, float, float]
) -> None:  # fmt: skip
    """Gains of θ̂ and Cov(ẽ, θ̃) after a fix with the innovation covariance of ``inverse``.

    Leaves Cov(y, θ̃) from before the fix in ``push``.
    """
    cross, lagged, learnt = own.cross[row], own.lagged[row], own.learnt[target]
    now, ago, gain, after = F32(s), F32(1.0 - s), own.gain[target], own.cross[target]
    i00, i01, i11 = F32(inverse[0]), F32(inverse[1]), F32(inverse[2])
    g00, g01, g10, g11 = F32(gain[0, 0]), F32(gain[0, 1]), F32(gain[1, 0]), F32(gain[1, 1])
    both = cross.shape[1]
    for j in range(both):
        x, y = now * cross[0, j] + ago * lagged[0, j], now * cross[1, j] + ago * lagged[1, j]
        learnt[0, j], learnt[1, j] = i00 * x + i01 * y, i01 * x + i11 * y
        own.push[0, j], own.push[1, j] = x, y
    for j in range(both):
        after[0, j] -= g00 * own.push[0, j] + g01 * own.push[1, j]
        after[1, j] -= g10 * own.push[0, j] + g11 * own.push[1, j]


@vector
def turn(one: FloatArray, other: FloatArray, c: float, s: float) -> None:
    """Rotate two rows by the angle whose cosine and sine are ``c`` and ``s``."""
    for j in range(len(one)):
        x, y = one[j], other[j]
        one[j], other[j] = c * x + s * y, c * y - s * x


@vector
def absorb(known: FloatArray, rank: int, row: FloatArray) -> int:
    """Add ``row`` (n,) to K = ``known[:rank]`` (n, n), so that K'K grows by row' row; returns the new rank.

    Rotations make its first elements zero, as when a row is added to a QR decomposition; overwrites ``row``.
    """
    n = len(row)
    for i in range(n):
        if i == rank:
            for j in range(n):
                known[i, j] = row[j]
            return rank + 1
        size = math.sqrt(known[i, i] * known[i, i] + row[i] * row[i])
        if size == 0.0:
            continue
        c, s = known[i, i] / size, row[i] / size
        turn(known[i, i:], row[i:], c, s)
    return rank


# --- fixes ------------------------------------------------------------------------------------


@kernel
def last_inside(landmarks: Landmarks, k: int, begin: Point, end: Point) -> float:
    """The last share in [0, 1] of the segment that lies in landmark ``k``; -1 if none does."""
    faces, disc = landmarks.faces, landmarks.disc[k]
    x, y = 0.5 * (begin.x + end.x) - disc[0], 0.5 * (begin.y + end.y) - disc[1]
    dx, dy = 0.5 * (end.x - begin.x), 0.5 * (end.y - begin.y)
    reach = disc[2] + math.sqrt(dx * dx + dy * dy)
    if x * x + y * y > reach * reach:
        return -1.0
    first, last = 0.0, 1.0
    for j in range(faces.ptr[k], faces.ptr[k + 1]):
        nx, ny = faces.normal[j, 0], faces.normal[j, 1]
        here = faces.offset[j] - nx * begin.x - ny * begin.y
        there = faces.offset[j] - nx * end.x - ny * end.y
        if here < 0.0 and there < 0.0:
            return -1.0
        if here < 0.0:
            first = max(first, here / (here - there))
        elif there < 0.0:
            last = min(last, here / (here - there))
    return last if first <= last else -1.0


@implements(observe, Navigator)
def _observe_landmarks(pilot: Navigator, motion: Motion, t: int, x: FloatArray) -> None:
    own, marks = pilot.beliefs, pilot.landmarks
    if t > 0:
        fill_step(pilot, motion.dt, t)
        stay(pilot.moves, t)
    free, fades = 0, t > 0 and changes(pilot.law.kept[t])
    for i in range(len(x)):
        if fades and pilot.fixed[i]:
            fade_field(pilot.field[i], pilot.law.kept[t])
        here = Point(x[i, t, 0], x[i, t, 1])
        begin = Point(x[i, t - 1, 0], x[i, t - 1, 1]) if t > 0 else here
        mark, share = -1, -1.0
        for k in range(len(marks.disc)):
            s = last_inside(marks, k, begin, here)
            if s > share:
                mark, share = k, s
        if mark < 0:
            continue
        row, part = pilot.history[i], min(int(share * SHARES + 0.5), SHARES) if t > 0 else SHARES
        part = max(part, 1)
        group = group_at(pilot, t, row)
        target = own.child[group, mark, part - 1]
        if target < 0:
            carry_belief(pilot, t, row)
            free = free_row(own, free)
            target = free
            own.child[group, mark, part - 1] = target
            learn_from_fix(own, row, target, part / SHARES, marks.cov[mark])
            own.step[target], own.last[target] = t, t + 1
            free += 1
        own.flights[row] -= 1
        own.flights[target] += 1
        pilot.history[i], pilot.fixed[i] = target, True
        take_fix(pilot, t, i, mark, (begin, here), share if t > 0 else 1.0)


@kernel
def free_row(own: Beliefs, begin: int) -> int:
    """The first row from ``begin`` on that no flight uses."""
    row = begin
    while row < own.used[0] and own.flights[row] != 0:
        row += 1
    if row == own.used[0]:
        own.used[0] += 1
        own.flights[row] = 0
    return row


@vector
def fade_field(field: Float32Array, kept: Float32Array) -> None:
    """Multiply θ̂ = ``field`` (2P,) by ``kept`` (P,)."""
    modes = len(kept)
    for c in range(2):
        for m in range(modes):
            field[c * modes + m] *= kept[m]


@kernel
def take_fix(pilot: Navigator, t: int, i: int, mark: int, step: tuple[Point, Point], share: float) -> None:
    """Update ê and θ̂ of flight ``i`` by a noisy measurement at ``share`` of the step between two points."""
    law, own, estimate, field = pilot.law, pilot.beliefs, pilot.estimate[i], pilot.field[i]
    (begin, here), root, row = step, pilot.root[mark], pilot.history[i]
    one, two = pilot.noise[t, i, 0], pilot.noise[t, i, 1]
    ago, before = 1.0 - share, max(t - 1, 0)
    dx = share * (here.x - law.x[t, 0] - estimate[0]) + ago * (begin.x - law.x[before, 0] - estimate[2])
    dy = share * (here.y - law.x[t, 1] - estimate[1]) + ago * (begin.y - law.x[before, 1] - estimate[3])
    dx += root[0, 0] * one
    dy += root[1, 0] * one + root[1, 1] * two
    gain = own.gain[row]
    estimate[0] += gain[0, 0] * dx + gain[0, 1] * dy
    estimate[1] += gain[1, 0] * dx + gain[1, 1] * dy
    add_learnt(field, own.learnt[row], dx, dy)


@vector
def add_learnt(field: Float32Array, learnt: Float32Array, dx: float, dy: float) -> None:
    """Add what an innovation (dx, dy) [m] says to θ̂ = ``field`` (2P,); gains ``learnt`` (2, 2P)."""
    x, y = F32(dx), F32(dy)
    for j in range(len(field)):
        field[j] += learnt[0, j] * x + learnt[1, j] * y


# --- control ----------------------------------------------------------------------------------


@implements(command, Navigator)
def _command_navigator(
    pilot: Navigator, motion: Motion, t: int, i: int, _at: Point, _wind: Point
) -> tuple[float, float]:  # fmt: skip
    law, estimate = pilot.law, pilot.estimate[i]
    planned_x, planned_y = law.u[t, 0], law.u[t, 1]
    if not pilot.fixed[i]:
        return planned_x, planned_y
    ex, ey, b_inv, b, dt, F = estimate[0], estimate[1], motion.b_inv, motion.b, motion.dt, law.F[t]
    field, modes, half = pilot.field[i], law.psi.shape[2], law.kept.shape[1]
    hx, hy = dot(law.psi[t, 0], field[:modes]), dot(law.psi[t, 1], field[half : half + modes])
    for q in range(law.push.shape[2]):
        known = field[place_of_error(q, modes, half)]
        hx, hy = hx + law.push[t, 0, q] * known, hy + law.push[t, 1, q] * known
    share = pilot.landmarks.gain / dt
    cx, cy = share * ex + hx, share * ey + hy
    ux, uy = within_airspeed(
        motion,
        planned_x - (b_inv[0, 0] * cx + b_inv[0, 1] * cy),
        planned_y - (b_inv[1, 0] * cx + b_inv[1, 1] * cy),
    )
    du, dv = ux - planned_x, uy - planned_y
    estimate[2], estimate[3] = ex, ey
    estimate[0] = F[0, 0] * ex + F[0, 1] * ey + dt * (hx + b[0, 0] * du + b[0, 1] * dv)
    estimate[1] = F[1, 0] * ex + F[1, 1] * ey + dt * (hy + b[1, 0] * du + b[1, 1] * dv)
    return ux, uy
