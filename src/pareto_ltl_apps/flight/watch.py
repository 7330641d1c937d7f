"""A flight against its plan: the belief from readings, what remains of the promise, and alarms."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.random import SeedSequence

from careful_io.texts import probability_text
from flight_quantities.medium import AIR, Medium
from pareto_ltl.extend import Plan, Problem, plan_on_branch
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.counts import clopper_pearson
from pareto_ltl.support.errors import ConfigError, DataError
from pareto_ltl_apps.conditioning import Fix
from pareto_ltl_apps.exports.ellipses import axes_of, ellipse_scale
from pareto_ltl_apps.flight.belief import LAW, Belief, Estimate
from pareto_ltl_apps.flight.branches import Changes, rejoining, selected_branch
from pareto_ltl_apps.flight.goals import BELIEVED, Goal, completed, planned_goals, reached
from pareto_ltl_apps.flight.position_fixes import causes, chance, in_plane, on_map
from pareto_ltl_apps.flight.rules import ADVICE, Event, Rules, alarm, event_of
from pareto_ltl_apps.flight.telemetry import MICROSECONDS, Reading, Sieve

TICK = 1.0  # [s] at least, between two lines of what was flown
SURPRISE = 4.0  # standard deviations above which a fix is an alarm and not used
AGREEING = 3  # such fixes in a row that agree with each other are believed
DRIFT = 3.0  # [m/s] by which the drift between two fixes may differ from the believed one
WAITING = 10.0  # [s] between two events before the departure
APART = 10.0  # [s] between two fixes that are used: the errors of closer ones are not independent
DRAWN = 60  # flights of the rest that are drawn
USES = {
    "refused": "it is not used",
    "restarted": f"{AGREEING} such fixes agree with each other: the position is believed from here, and what "
    "was learnt of the wind is forgotten",
}
ELLIPSE = ellipse_scale(0.95)  # standard deviations


@dataclass(frozen=True, slots=True)
class WatchSettings:
    """What a watch does; ConfigError if a value is beyond its limits.

    Attributes
    ----------
    every : float
        Seconds between two statuses, from which alarms follow.
    alarm : float
        Failure rate of the rest of the plan above which an alarm is raised, and again where it doubles.
    members : int
        Simulated flights of the rest of the plan.
    silence : float
        Seconds without telemetry after which the controls of the plan are assumed.
    wind_age : float
        Age of the forecast [s] above which an alarm is raised.
    lines : float
        Seconds between two statuses that are shown to the pilot.
    """

    every: float = 60.0
    alarm: float = 0.2
    members: int = 1000
    silence: float = 120.0
    wind_age: float = math.inf
    lines: float = 600.0

    def __post_init__(self) -> None:
        if not 1.0 <= self.every <= 86_400.0:
            raise ConfigError(f"every must be 1 to 86,400 s, got {self.every:g}")
        if not 0.0 < self.alarm <= 1.0:
            raise ConfigError(f"alarm must be a failure rate above 0 and at most 1, got {self.alarm:g}")
        if not self.wind_age > 0.0:
            raise ConfigError(f"wind_age must be above 0 h, got {self.wind_age / 3600.0:g}")
        if not 50 <= self.members <= 100_000:
            raise ConfigError(f"members must be 50 to 100,000, got {self.members}")
        if not 1.0 <= self.lines <= 86_400.0:
            raise ConfigError(f"lines must be 1 to 86,400 s, got {self.lines:g}")


class Watch:
    """The state of a watch; :meth:`take` turns each reading into events.

    Every event has ``event``, its kind, and ``time`` [s after departure]. ``issued`` is the start of the
    forecast [s after departure]; NaN if it is not known. ``medium`` has the words for the flow.
    """

    def __init__(
        self, problem: Problem, plan: Plan, settings: WatchSettings, seed: SeedSequence,
        issued: float = math.nan, medium: Medium = AIR,
    ) -> None:  # fmt: skip
        self.problem, self.plan, self.settings, self.medium = problem, plan, settings, medium
        self.belief = Belief(problem, settings.members, seed)
        self.sieve = Sieve(plan.u_max)
        self.velocity: FloatArray | None = None  # through the air, by the last reading [m/s]
        self.pending, self.air, self.energy = 0.0, np.zeros(2), 0.0
        self.due, self.heard, self.last_fix = 0.0, 0.0, -math.inf
        self.line_due = 0.0  # when a status is shown again [s]
        self.waited = -math.inf  # time of the last event before the departure
        self.goals, self.missed = list(planned_goals(problem, plan.path)), list[Goal]()
        self.suspects: list[tuple[float, FloatArray, FloatArray]] = []
        self.raised: set[str] = set()
        self.rules = Rules(self, issued if math.isfinite(issued) else 0.0)  # no older than the departure
        self.heard_wind: tuple[float, float] | None = None
        self.rest = np.empty((0, 1, 2)), np.empty(0, bool)  # flights of the last status, and which fail
        self.turn, self.turned = 0.0, -1  # meridian convergence [rad], and the step it was computed at

    @property
    def time(self) -> float:
        """Seconds after departure until which readings were taken, as exact as the times of readings."""
        return round(self._flown_until, MICROSECONDS)

    @property
    def _flown_until(self) -> float:
        return self.belief.time + self.pending

    @property
    def over(self) -> bool:
        """Whether the plan or the wind has ended."""
        return self.belief.ended or self.belief.step >= len(self.plan.path.u)

    # --- readings ---

    def events(self, readings: Iterable[Reading]) -> Iterator[Event]:
        """The events of a stream of readings, and of its end."""
        for reading in self.sieve.usable(readings):
            yield from self.take(reading)
            if self.over:
                break
        yield from self.flushed()
        yield from self._passed_goals()
        if self.sieve.refused:
            yield event_of("unused", self.time, refused=dict(self.sieve.refused))
        end = self.status() | {"event": "end", "refused": dict(self.sieve.refused), "over": self.over}
        end["complete"] = completed(self.problem, self.belief)
        yield end | {"ahead": self._ahead()}

    def take(self, reading: Reading) -> Iterator[Event]:
        """The events of one usable reading."""
        if reading.time < 0.0:
            self.sieve.refused["before departure"] += 1
            if reading.time >= self.waited + WAITING:
                first, self.waited = not math.isfinite(self.waited), reading.time
                yield event_of("waiting", 0.0, seconds=-reading.time, shown=first)
            return
        yield from self._fly_until(reading.time)
        yield from self._passed_goals()
        if reading.lost:
            yield from self._lost(reading.lost)
        if math.isfinite(reading.heading):
            self.velocity, self.heard = reading.airspeed * self._direction(reading.heading), reading.time
            self.raised -= {"silence", "signals"}
        self.heard_wind = reading.wind or self.heard_wind
        if math.isfinite(reading.battery):
            self.rules.take_battery(reading.time, reading.battery)
        if reading.place is not None:
            yield from self._fix(reading.place, reading.sd)
        if self.time >= self.due:
            yield from self.flushed()
            yield from self._reported()

    def _lost(self, signals: Sequence[str]) -> Iterator[Event]:
        """An alarm about signals that are older than they may be."""
        yield from self._alarm(
            "signals", f"no {' and no '.join(signals)} for more than 2 s: the last ones are flown until "
            f"{self.settings.silence:.0f} s have passed, then the controls of the plan; no estimate is sent",
        )  # fmt: skip

    def _passed_goals(self) -> Iterator[Event]:
        """An event for each goal whose planned time has come; an alarm where the plan leaves it in vain."""
        while self.goals and self.belief.step >= self.goals[0].step:
            goal = self.goals.pop(0)
            probability = reached(self.problem, self.belief, goal)
            yield self._goal(goal, probability, late=False)
            if probability < BELIEVED:
                self.missed.append(goal)
        for goal in self.missed:
            kind = f"goal {goal.step}"
            if self.belief.step >= goal.left and kind not in self.raised:
                text = probability_text(reached(self.problem, self.belief, goal))
                yield from self._alarm(
                    kind, f"the plan leaves {goal.name}, which is reached with probability {text}"
                )

    def _goal(self, goal: Goal, probability: float, *, late: bool) -> Event:
        planned = goal.step * self.problem.motion.dt
        return event_of(
            "goal", self.time, goal=list(goal.labels), planned=planned, probability=probability, late=late
        )

    def _fly_until(self, time: float) -> Iterator[Event]:
        """Fly on, no longer than the plan, with the last known airspeed, or as planned in a long silence."""
        elapsed, velocity, silent = time - self._flown_until, self.velocity, time - self.heard
        if silent > self.settings.silence:
            text = f"no heading and airspeed for {silent:.0f} s: the controls of the plan are assumed"
            yield from self._alarm("silence", text)
            velocity = None
        if velocity is None:
            yield from self.flushed()
        dt, steps = self.problem.motion.dt, len(self.plan.path.u)
        while elapsed > 0.0 and not self.over:
            left = steps * dt - self._flown_until
            part = min(elapsed, left)
            if velocity is None:  # the plan changes its controls at the steps
                part = min(part, (1.0 - self.belief.share) * dt)
            self._flown(part, self._planned() if velocity is None else velocity)
            elapsed -= part
            if self.pending >= TICK or velocity is None or part == left:
                yield from self.flushed()

    def _flown(self, seconds: float, velocity: FloatArray) -> None:
        self.pending += seconds
        self.air = self.air + seconds * velocity
        if self.problem.energy is not None:
            self.energy += float(self.problem.energy.of(velocity[None], seconds))

    def _planned(self) -> FloatArray:
        """The control of the plan now (2,) [m/s]."""
        u = self.plan.path.u
        return np.asarray(u[min(int((self.time + 1e-6) / self.problem.motion.dt), len(u) - 1)], float)

    def _direction(self, heading: float) -> FloatArray:
        """Unit vector in the plane of a true ``heading`` [deg] at the believed position."""
        angle = math.radians(heading) - self._turn()
        return np.array([math.sin(angle), math.cos(angle)])

    def _turn(self) -> float:
        """Meridian convergence [rad] where this step began, to be added to directions in the plane."""
        scene = self.problem.scene
        if scene.crs is not None and self.turned != self.belief.step:
            lon, lat = scene.frame.to_geographic(self.belief.x[None])
            self.turn, self.turned = float(scene.frame.convergence(lon, lat)[0]), self.belief.step
        return self.turn

    def flushed(self) -> Iterator[Event]:
        """Give what was flown since the last time to the belief."""
        if self.pending > 0.0:
            east, north = self.air.tolist()
            event = event_of("flown", self.time, seconds=self.pending, east=east, north=north)
            self._advance(event)
            yield event

    def _advance(self, event: Mapping[str, Any]) -> None:
        air = self.problem.motion.b @ np.array([event["east"], event["north"]])
        self.belief.advance(float(event["seconds"]), air)
        self.pending, self.air = 0.0, np.zeros(2)

    def resume(self, events: Iterable[Mapping[str, Any]]) -> None:
        """Take the events of an earlier watch of the same flight."""
        for event in events:
            if event["event"] == "flown":
                self._advance(event)
            elif event["event"] == "fix":
                self._believe(event)
            elif event["event"] == "branch":
                first, later = (np.array(event.get(key, (0.0, 0.0)), float) for key in ("change", "later"))
                self._take_branch(event["name"], (first, later))
            elif event["event"] == "status":
                self.energy, self.due = event["energy"] or 0.0, event["time"] + self.settings.every
                self.line_due = event["time"] + self.settings.lines if event["shown"] else self.line_due
        while self.goals and self.belief.step >= self.goals[0].step:
            goal = self.goals.pop(0)
            if reached(self.problem, self.belief, goal) < BELIEVED:
                self.missed.append(goal)
        self.sieve.last = self.heard = self.time

    # --- fixes ---

    def _fix(self, given: tuple[float, float], sd: float) -> Iterator[Event]:
        place = in_plane(self.problem, *given)
        if place is None or not on_map(self.problem, place):
            self.sieve.refused["position off the map"] += 1
            where = ",".join(f"{value:.4f}" for value in given)
            none = ", as receivers report that have no position" if given == (0.0, 0.0) else ""
            yield from self._alarm("map", f"a position fix at {where} is off the map{none}; it is not used")
            return
        if self.time < max(self.last_fix, self.suspects[-1][0] if self.suspects else -math.inf) + APART:
            self.sieve.refused[f"position within {APART:g} s of the last"] += 1
            return
        yield from self.flushed()
        far = self.belief.distance(place, sd**2 * np.eye(2))
        use = "learnt" if far <= SURPRISE else "restarted" if self._confirmed(place, sd) else "refused"
        event = event_of(
            "fix", self.time, place=place.tolist(), given=list(given), sd=sd, distance=far, use=use, law=LAW
        )
        yield event
        if far > SURPRISE:
            step = min(round(self.time / self.problem.motion.dt), len(self.plan.path.u))
            why = "; ".join(causes(self.problem, self.plan.path, Fix(place, sd, step)))
            self.raised.discard("fix")
            yield from self._alarm(
                "fix", f"a position fix lies {far:.1f} standard deviations from where {LAW} "
                f"{self.medium.flows} allow the robot (probability {chance(far):.1g}): {USES[use]}; {why}",
            )  # fmt: skip
        if self._believe(event):
            self.due = self.line_due = self.time
            self.raised -= {"map"} if far > SURPRISE else {"map", "fix"}
            yield from self._branched(place)

    def _branched(self, place: FloatArray) -> Iterator[Event]:
        """Which branch of the plan a fix that is used selects; the watch then follows it."""
        found = selected_branch(self.plan, self.time, place)
        if found is None or self.plan.branching is None:
            return
        (branch, changes), fix = found, self.plan.branching.fix
        added = dict[str, Any]()
        if fix.rejoin:
            added = {"change": changes[0].tolist(), "seconds": fix.rejoin * self.plan.dt}
        if fix.counter:
            added["later"] = changes[1].tolist()
        yield event_of(
            "branch", self.time, name=branch.name, where=branch.cell.words, failure=branch.rate.failure,
            **added,
        )  # fmt: skip
        self._take_branch(branch.name, changes)

    def _take_branch(self, name: str, changes: Changes) -> None:
        """Follow the branch ``name`` from here on, with ``changes`` to its velocities."""
        tree = self.plan.branching
        branch = next((one for one in tree.branches if one.name == name), None) if tree else None
        if branch is None:
            raise DataError(f"the journal names branch {name}, which the plan does not have")
        assert tree is not None
        self.plan = plan_on_branch(self.plan, branch)
        if tree.fix.rejoin:
            path = self.plan.path
            u = rejoining(self.problem, tree, changes, path.u)
            log = self.problem.scene.frame.navigation(path.t, path.x, u)
            self.plan = replace(self.plan, path=replace(path, u=u), navigation=log)
        now = self.belief.step
        self.goals = [goal for goal in planned_goals(self.problem, self.plan.path) if goal.step > now]

    def _believe(self, fix: Mapping[str, Any]) -> bool:
        """Give an event ``fix`` to the belief; returns whether it is used."""
        take = {"learnt": self.belief.learn, "restarted": self.belief.restart}.get(fix["use"])
        if take is None:
            return False
        take(np.array(fix["place"], float), float(fix["sd"]) ** 2 * np.eye(2))
        self.last_fix, self.suspects = float(fix["time"]), []
        return True

    def _confirmed(self, place: FloatArray, sd: float) -> bool:
        """Whether the last refused fixes agree with ``place`` and with the believed motion between them."""
        mean = self.belief.estimate().mean
        wide = SURPRISE * math.sqrt(2.0) * sd
        near = [
            np.linalg.norm((place - other) - (mean - then)) <= wide + DRIFT * (self.time - t)
            for t, other, then in self.suspects
        ]
        self.suspects = [*(self.suspects if all(near) else []), (self.time, place, mean)]
        return len(self.suspects) >= AGREEING

    # --- what is reported ---

    def _alarm(self, kind: str, text: str) -> Iterator[Event]:
        """An alarm of a kind with what can be done, once until it ends."""
        if kind not in self.raised:
            self.raised.add(kind)
            name = kind.partition(" ")[0]
            yield alarm(self.time, name, text, ADVICE[name])

    def _reported(self) -> Iterator[Event]:
        """A status, and the alarms that follow from it."""
        status, now = self.status(), self.time
        self.due = now + self.settings.every
        if now >= self.line_due:
            status["shown"], self.line_due = True, now + self.settings.lines
        for goal in list(self.missed) if status["shown"] else []:
            if (probability := reached(self.problem, self.belief, goal)) >= BELIEVED:
                self.missed.remove(goal)
                self.raised.discard(f"goal {goal.step}")
                yield self._goal(goal, probability, late=True)
            else:
                status["missed"].append({"goal": list(goal.labels), "probability": probability})
        yield status
        for kind, text in self.rules.faults(status):
            if text:
                yield from self._alarm(kind, text)
            else:
                self.raised.discard(kind)

    def status(self) -> Event:
        """The estimated position of the robot, and the failure rate of the rest of the plan from there."""
        now, path = self.belief.estimate(), self.plan.path
        step = min(round(self.time / self.problem.motion.dt), len(path.u))
        planned, spread = self._planned_place()
        gap = now.mean - planned
        flown, failed = self.belief.rest_fails(path.u, path.x)
        self.rest = flown[:DRAWN, self.belief.step :].copy(), failed[:DRAWN]
        fails, flights, promise = int(failed.sum()), len(failed), self.plan.promise
        low, high = clopper_pearson(fails, flights)
        return event_of(
            "status", self.time, step=step, **self.placed(now.mean), **self._ellipse(now.cov),
            corridor=float(np.sqrt(gap @ np.linalg.solve(spread, gap))), law=LAW, medium=self.medium.matter,
            failure=fails / flights, low=low, high=high, fails=fails, flights=flights,
            promised=promise and promise.rate.failure,
            **self.wind_now(now),
            energy=None if self.problem.energy is None else self.energy,
            energy_needed=self._energy_needed(), heard_wind=self.heard_wind and list(self.heard_wind),
            battery=self.rules.battery if math.isfinite(self.rules.battery) else None,
            shown=False, missed=[], **self._next_goal(),
        )  # fmt: skip

    def wind_now(self, now: Estimate) -> Event:
        """The estimated wind [m/s], the true direction it comes from [deg], and its sd in a component."""
        east, north = now.wind
        return {
            "wind": now.wind.tolist(),
            "wind_from": math.degrees(math.atan2(-east, -north) + self._turn()) % 360.0,
            "wind_sd": float(np.sqrt(np.trace(now.wind_cov) / 2.0)),
        }

    def _planned_place(self) -> tuple[FloatArray, FloatArray]:
        """Expected position (2,) [m] and its covariance (2, 2) [m²] now by the plan, linear along a leg."""
        path = self.plan.path
        at = min(self.time / self.problem.motion.dt, float(len(path.u)))
        k = min(int(at + 1e-9), len(path.u) - 1) if len(path.u) else 0
        s, later = at - k, min(k + 1, len(path.u))
        x = (1.0 - s) * path.x[k] + s * path.x[later]
        return x, (1.0 - s) * path.cov[k] + s * path.cov[later] + 1e-6 * np.eye(2)

    def _energy_needed(self) -> float | None:
        """Energy until the end of the plan, with what was used [J]."""
        if self.problem.energy is None:
            return None
        dt, u = self.problem.motion.dt, self.plan.path.u
        step = min(int(self.time / dt + 1e-9), len(u))
        late = self.time - step * dt  # of the leg that is being flown
        flown = float(self.problem.energy.of(u[step : step + 1], late)) if step < len(u) else 0.0
        return self.energy + float(self.problem.energy.of(u[step:], dt)) - flown

    def _ahead(self) -> list[Event]:
        """Mean (2,) [m] and covariance (2, 2) [m²] now and at the steps to come, flown on as planned.

        The belief is at the end of the plan, or of the wind, afterwards.
        """
        dt, found = self.problem.motion.dt, list[Event]()
        while True:
            now = self.belief.estimate()
            found.append({"time": self.belief.time, "mean": now.mean.tolist(), "cov": now.cov.tolist()})
            if self.over:
                return found
            rest = (self.belief.step + 1) * dt - self.belief.time
            self.belief.advance(rest, self.problem.motion.b @ (rest * self._planned()))

    def placed(self, x: FloatArray) -> Event:
        """``x`` (2,) [m] in the plane and, on a map with a place on Earth, in degrees."""
        placed: Event = {"x": float(x[0]), "y": float(x[1])}
        if self.problem.scene.crs is not None:
            lon, lat = self.problem.scene.frame.to_geographic(x[None])
            placed |= {"lat": float(lat[0]), "lon": float(lon[0])}
        return placed

    @staticmethod
    def _ellipse(cov: FloatArray) -> Event:
        """Half axes [m] of the ellipse that holds 95 %, and the angle of the longer one from +x [rad]."""
        major, minor, azimuth = (float(part[0]) for part in axes_of(cov[None]))
        return {"major": ELLIPSE * major, "minor": ELLIPSE * minor, "angle": 0.5 * math.pi - azimuth}

    def _next_goal(self) -> Event:
        """The next labels that change the state of the mission, by the plan, and when [s after departure]."""
        path, dt = self.plan.path, self.problem.motion.dt
        now = min(int(self.time / dt + 1e-9), len(path.u))
        for t in range(now + 1, len(path.q)):
            if path.q[t] != path.q[now]:
                return {"goal": sorted(path.label[t]), "goal_time": t * dt, "end": len(path.u) * dt}
        return {"goal": [], "goal_time": None, "end": len(path.u) * dt}
