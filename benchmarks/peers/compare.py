"""Our planner and logic and their peers in turn; figures as JSON, ratios as a table.

    make peers            # ARGS="--repeats 20 --out build/peers.json"

All times are CPU seconds of one process on one thread, so that other work on the machine counts little.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import sys
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

from ltlf import patterns
from machine import processor
from pareto_ltl.logic import translate
from peers import tables
from peers.channel import Peer, missing
from peers.ours import ORDERS, Mission, translation_seconds

PEERS = ("ompl", "drake", "mona")
BUDGETS = (0.1, 0.5, 1.0)  # CPU time for a mission [s]
PLANNERS = {  # of OMPL: name in the table -> class, and whether it takes our step or chooses its own
    "RRT*, our step": ("RRTstar", True),
    "RRT*": ("RRTstar", False),
    "AORRTC": ("AORRTC", False),
}
Figures = dict[str, Any]


def disjoint(names: list[str]) -> list[frozenset[str]]:
    return [frozenset[str](), *(frozenset({name}) for name in names)]


def never_two(names: list[str]) -> str:
    """The formula that no two places are ever visited at once; over infinite words it is not co-safe."""
    pairs = [f"(!{a} | !{b})" for i, a in enumerate(names) for b in names[i + 1 :]]
    return f"G({' & '.join(pairs)})"


def logic_cases() -> Iterator[tuple[str, str, list[frozenset[str]] | None, str, int]]:
    """Name, our formula and letters, MONA's formula, and the number of states that MONA has in addition.

    MONA's first state only reads the free variables. Over disjoint places it also has a trap state for
    letters that cannot occur; our automata have no such letters.
    """
    ten, twelve = [f"p{i}" for i in range(10)], [f"p{i}" for i in range(12)]
    phi1, phi2 = "F(a & F b & F c)", "F(a & F(b & F c)) | F(a & F(d & F c))"
    key6 = patterns.key_door(*((f"k{i}", f"d{i}") for i in range(6)))
    yield "phi1", phi1, None, phi1, 1
    yield "phi2", phi2, None, phi2, 1
    yield "ten places in any order", patterns.coverage(*ten), None, patterns.coverage(*ten), 1
    within = f"{patterns.coverage(*ten)} & {never_two(ten)}"
    yield "ten disjoint places in any order", patterns.coverage(*ten), disjoint(ten), within, 2
    yield "twelve places in sequence", patterns.sequence(*twelve), None, patterns.sequence(*twelve), 1
    yield "six keys and doors", key6, None, key6, 1


def compare_logic(mona: Peer | None, repeats: int) -> Figures:
    figures: Figures = {}
    for name, ours, letters, theirs, beyond in logic_cases():
        case: Figures = {"states": translate(ours, letters).n_states, "ours": [], "through": [], "alone": []}
        for _ in range(3):  # memory is asked of the system once
            translation_seconds(ours, letters)
        for _ in range(repeats):
            case["ours"].append(translation_seconds(ours, letters))
            if mona is not None:
                told = mona.ask(formula=theirs, op="formula")
                if told["states"] != case["states"] + beyond:
                    raise AssertionError(f"{name}: {case['states']} states, MONA has {told['states']}")
                case["through"].append(told["through"])
                case["alone"].append(told["alone"])
        figures[name] = case
    return figures


def ompl_mission(ompl: Peer, name: str, scene: Figures, planner: str, seconds: float | None) -> Figures:
    """The shorter of the two orders, leg by leg; each leg starts where the one before ended.

    Every leg gets an equal share of ``seconds``. Without ``seconds``: the first path of the first order.
    """
    kind, ours = PLANNERS[planner]
    orders = ORDERS[name] if seconds is not None else ORDERS[name][:1]
    ways = {order[: k + 1] for order in orders for k in range(len(order))}
    ends: dict[tuple[str, ...], tuple[list[float], float]] = {(): (scene["start"], 0.0)}
    total = {"cpu": 0.0, "vertices": 0, "checks": 0}
    for way in sorted(ways, key=lambda way: (len(way), way)):
        if way[:-1] not in ends:
            continue
        start, before = ends[way[:-1]]
        told = ompl.ask(
            op="leg", name=name, planner=kind, start=start, goal=scene["regions"][way[-1]],
            seconds=None if seconds is None else seconds / len(ways), step=scene["step"] if ours else None,
        )  # fmt: skip
        for key in total:
            total[key] += told[key]
        if told["length"] is not None:
            ends[way] = told["end"], before + told["length"]
    lengths = [ends[order][1] * 100 for order in orders if order in ends]
    return total | {"length": min(lengths, default=None)}


def compare_missions(peers: dict[str, Peer], repeats: int) -> Figures:
    figures: Figures = {}
    for name in ORDERS:
        mission = Mission.named(name)
        scene = mission.for_peers()
        mission.first_path(0)  # machine code is made and loaded here
        mission.plan(0)
        case: Figures = {"first": [], "plan": [], "drake": []}
        figures[name] = case
        case["ompl"] = {planner: {"first": [], "budgets": []} for planner in PLANNERS}
        if "ompl" in peers:
            told = peers["ompl"].ask(op="map", name=name, side=scene["side"], obstacles=scene["obstacles"])
            case["check_seconds"] = told["check_seconds"]
        for k in range(repeats):
            print(f"{name}: repetition {k + 1} of {repeats}", file=sys.stderr, flush=True)
            repeat_mission(peers, mission, scene, case, k)
    return figures


def repeat_mission(
    peers: dict[str, Peer], mission: Mission, scene: Figures, case: Figures, seed: int
) -> None:
    """One repetition of all planners, added to ``case``."""
    case["first"].append(finite(mission.first_path(seed)))
    case["plan"].append({key: finite(value) for key, value in mission.plan(seed).items()})
    if "ompl" in peers:
        for planner, runs in case["ompl"].items():
            runs["first"].append(ompl_mission(peers["ompl"], mission.name, scene, planner, None))
            budgets = [ompl_mission(peers["ompl"], mission.name, scene, planner, s) for s in BUDGETS]
            runs["budgets"].append(dict(zip(map(str, BUDGETS), budgets, strict=True)))
    if "drake" in peers:
        keys = ("cells", "doors", "inside", "start")
        case["drake"].append(
            peers["drake"].ask(op="mission", orders=ORDERS[mission.name], **{key: scene[key] for key in keys})
        )


def finite(value: float) -> float | None:
    """``value`` for JSON, which has no infinity."""
    return value if value < float("inf") else None


def machine() -> Figures:
    system = f"{platform.system()} {platform.machine()}"
    return {"processor": processor(), "cores": os.cpu_count(), "system": system}


def open_peers(wanted: list[str], environments: Path, say: Callable[[str], None]) -> dict[str, Peer]:
    peers = {}
    for name in wanted:
        absent = missing(name, environments)
        if absent is None:
            peers[name] = Peer(name, environments)
        else:
            say(absent)
    return peers


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--repeats", type=int, default=10, help="repetitions, each with another seed")
    parser.add_argument("--out", type=Path, default=Path("build/peers.json"), help="all figures")
    parser.add_argument("--environments", type=Path, default=Path("build/peers"), help="where the peers are")
    parser.add_argument("--peers", nargs="*", choices=PEERS, default=list(PEERS))
    given = parser.parse_args()
    peers = open_peers(given.peers, given.environments, lambda line: print(line, file=sys.stderr))
    versions = {name: version(name) for name in ("pareto-ltl", "numpy", "numba", "clarabel")}
    versions |= {"python": platform.python_version()}
    for peer in peers.values():
        versions |= peer.ask(op="version")
    data = {
        "date": datetime.now(UTC).date().isoformat(), "repeats": given.repeats, "machine": machine(),
        "versions": versions, "peers": list(peers),
        "logic": compare_logic(peers.get("mona"), given.repeats),
        "missions": compare_missions(peers, given.repeats),
    }  # fmt: skip
    for peer in peers.values():
        peer.close()
    given.out.parent.mkdir(parents=True, exist_ok=True)
    given.out.write_text(json.dumps(data, indent=1) + "\n")
    print(tables.markdown(data))


if __name__ == "__main__":
    main()
