"""What the other commands answer: formulas, sweeps, forecast tests, the desk, machine code and the cache."""

from __future__ import annotations

import math
import sys
import textwrap
from argparse import Namespace
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from careful_io.links import refuse_links_out
from careful_io.locks import claim_folder
from careful_io.messages import shown_text, shown_value
from careful_io.texts import probability_text
from pareto_ltl import Settings
from pareto_ltl.support.errors import ConfigError, FormulaError
from pareto_ltl.support.extras import EXTRAS
from pareto_ltl_apps.cli.output import Answer, Output, print_answer, print_problem, shown_table

if TYPE_CHECKING:
    from pareto_ltl.extend import Automaton, Formula
    from pareto_ltl_apps.studies.promises import Promises
    from pareto_ltl_apps.view.records import Compared

DESK_LOCK = ".desk.lock"  # in its folder, which one server has at a time


def sweep(options: Namespace) -> Answer:
    """Write the summary of the folder of a sweep again."""
    if options.folder is None:
        raise ConfigError(
            "name the folder of a sweep (multirun/phi2), or settings to run (+experiment=phi2 seed=0,1); "
            "see pareto-ltl sweep --help"
        )
    from pareto_ltl_apps.cli.summary import sweep_answer
    from pareto_ltl_apps.studies.sweep_summary import write_summary
    from pareto_ltl_apps.studies.sweeps import OLDER_SWEEPS, FigureChoice

    refuse_links_out(options.folder)
    found = write_summary(options.folder, options.sweep, FigureChoice(options.x, options.y, options.by))
    out = options.folder / OLDER_SWEEPS / options.sweep if options.sweep else options.folder
    return sweep_answer(found, out / "summary.html")


def serve(options: Namespace, output: Output) -> int:
    """Serve the desk until Ctrl-C or a signal; return 0."""
    EXTRAS.require("serve", "serve")
    from pareto_ltl_apps.desk.app import desk_server

    desk = desk_server(options.folder, options.port)
    with claim_folder(options.folder / DESK_LOCK, "a desk", "give another --folder"):
        print_answer(Answer({"address": desk.address}, [desk.address], [desk.address]), output)
        sys.stdout.flush()  # a program that reads the address waits for it
        if not options.no_browser and not _open(desk.browser_address()):
            print("found no browser: open this address in one on this machine", file=sys.stderr)
        desk.serve()
    return 0


def _open(address: str) -> bool:
    import webbrowser

    try:
        return webbrowser.open(address)
    except (OSError, webbrowser.Error):
        return False


def warmup(options: Namespace) -> Answer:
    """What was compiled, by kind of run."""
    from pareto_ltl.extend import ProgressBar
    from pareto_ltl_apps.cli.warmup import DEFAULT, KINDS, warm_up_all

    if options.list:
        known = {name: kind.meaning for name, kind in KINDS.items()}
        return Answer({"kinds": known}, [f"{name:<24}{meaning}" for name, meaning in known.items()])
    for name in options.kinds:
        if name not in KINDS:
            raise ConfigError(f"there is no kind {shown_value(name)}; pareto-ltl warmup --list shows them")
    names = list(KINDS if options.all else options.kinds or DEFAULT)
    with ProgressBar() as bar, bar.stage("compiling"):
        found = list(warm_up_all(names, options.jobs, bar))
    kinds = [{**asdict(warmed), "seconds": round(warmed.seconds, 1)} for warmed in found]
    lines = []
    for warmed in found:
        lines.append(f"{warmed.name}: {len(warmed.compiled)} kernels compiled, {warmed.seconds:.0f} s")
        if not warmed.complete:
            lines.append(f"{warmed.name}: its small mission found no path, so some kernels may be missing")
    return Answer({"kinds": kinds, "compiled": sum(len(warmed.compiled) for warmed in found)}, lines)


def cache(options: Namespace) -> Answer:
    """Folder and size of the cache, after clearing it if that is asked for."""
    from careful_io.folders import folder_size
    from pareto_ltl.support import cache

    folder = cache.cache_root()
    files, total = folder_size(folder)
    if options.action == "clear":
        cache.clear_cache(folder)
        cleared = f"cleared {total / 2**20:.1f} MiB from {folder}"
        return Answer({"folder": folder, "cleared_bytes": total}, [cleared], [folder])
    limit = cache.cache_limit()
    size = f"{folder}: {files} files, {total / 2**20:.1f} of {limit / 2**20:.0f} MiB"
    return Answer({"folder": folder, "files": files, "bytes": total, "limit_bytes": limit}, [size], [folder])


# --- formulas --------------------------------------------------------------------------------


def formula(options: Namespace) -> Answer:
    """The meaning of a formula; after one line and a caret, exit code 2 for a mistake in it."""
    import numpy as np

    from ltlf import caret_lines
    from pareto_ltl.extend import disputed_reading, parse_formula, translate
    from pareto_ltl_apps.view.automaton_picture import dot_text, save_picture

    text = options.formula
    try:
        tree = parse_formula(text)
        alphabet = [(), *((name,) for name in tree.atoms)] if options.disjoint else None
        automaton = translate(text, alphabet, options.max_states)
    except FormulaError as error:
        print_problem(str(error))
        if error.column is not None:
            print(caret_lines(text, error.column), file=sys.stderr)
        return Answer({"error": str(error), "column": error.column}, code=2)
    if options.dot:
        Path(options.dot).write_text(dot_text(automaton), encoding="utf-8")
    if options.hoa:
        Path(options.hoa).write_text(automaton.to_hoa(), encoding="utf-8")
    if options.picture:
        save_picture(automaton, options.picture)
    written = [path for path in (options.dot, options.hoa, options.picture) if path]
    normal = tree.normal_form()
    document = {
        "formula": str(tree),
        "note": disputed_reading(text),
        "normal_form": str(normal),
        "propositions": automaton.atoms,
        "letters": len(automaton.letters),
        "states": automaton.n_states,
        "initial": automaton.initial,
        "accepting": np.flatnonzero(automaton.accepting),
        "distance": automaton.distance,
        "extra_visits_harmless": automaton.harm() is None,
        "written": written,
    }
    meaning = _meaning(tree, normal, automaton)
    if note := document["note"]:
        meaning["note"] = shown_text(str(note), 1000)
    return Answer(document, [f"{name:<14}{value}" for name, value in meaning.items()], written)


def _meaning(tree: Formula, normal: Formula, automaton: Automaton) -> dict[str, str]:
    """What the command prints of a formula, by name."""
    accepting = automaton.accepting.nonzero()[0].tolist()
    roles = (
        f"initial {automaton.initial}, accepting {accepting[0] if accepting else 'none'}, "
        f"{f'trap {automaton.trap}' if automaton.trap >= 0 else 'no trap'}"
    )
    letters, free = len(automaton.letters), 2 ** len(automaton.atoms)
    return {
        "formula": shown_text(str(tree), 1000),
        "normal form": shown_text(str(normal), 1000),
        "propositions": ", ".join(automaton.atoms) or "none",
        "letters": f"{letters} (all subsets)" if letters == free else f"{letters}",
        "states": f"{automaton.n_states} ({roles})",
        "d_A(initial)": _initial_distance(automaton),
        "extra visits": _extra_visits(automaton),
    }


def _initial_distance(automaton: Automaton) -> str:
    if automaton.tautology:
        return "0: a tautology, complete before the flight starts"
    if automaton.contradiction:
        return "inf: a contradiction, no flight completes it"
    steps = int(automaton.distance[automaton.initial])
    return f"{steps} letter{'s' * (steps > 1)} at least, the start position's among them"


def _extra_visits(automaton: Automaton) -> str:
    from pareto_ltl.extend import show_letter

    harm = automaton.harm()
    if harm is None:
        return "harmless: additional letters never make the mission fail (insertion-closed)"
    state, column = harm
    letter = show_letter(automaton.letters[column])
    after = int(automaton.delta[state, column])
    what = (
        "makes the mission fail"
        if after == automaton.trap
        else f"needs further visits (state {state} to {after})"
    )
    return f"not harmless: in state {state} an extra {letter} {what}"


# --- forecast tests --------------------------------------------------------------------------


def scores(options: Namespace) -> Answer:
    """Diagrams and scores of one forecast test, or of two."""
    if options.names and not options.other:
        raise ConfigError("--names names two tests; give OTHER too")
    from pareto_ltl_apps.studies import promises
    from pareto_ltl_apps.view.study_forecast_test import draw_promises

    EXTRAS.require("scores", "scores")
    for folder in filter(None, (options.folder, options.other)):
        refuse_links_out(folder)
    names = options.names or (None, None)
    mine = promises.read_promises(options.folder, options.fidelity, names[0])
    others = [*promises.references(mine)]
    if options.other:
        others.append(promises.read_promises(options.other, mine.fidelity, names[1]))
    found = [promises.compared(mine, other) for other in others]
    shown = found[-1] if options.other else found[0]
    folder = options.out or options.folder / "scores"
    folder.mkdir(parents=True, exist_ok=True)
    written = draw_promises(folder, promises.diagrams(mine, others, shown))
    parts = promises.score_parts(mine)
    lines = [*_score_lines(mine, found, parts), f"wrote {', '.join(map(str, written))}"]
    return Answer({**_score_document(mine, found, parts), "written": written}, lines, written)


def _score_document(mine: Promises, found: Sequence[Compared], parts: dict[str, float]) -> dict[str, object]:
    from pareto_ltl_apps.studies import calibration

    return {
        "name": mine.name,
        "fidelity": mine.fidelity,
        "plans": len(mine.missions),
        "promised": float(mine.promised.mean()),
        "failed": float(mine.realised.mean()),
        **{name.replace("Brier score", "brier"): value for name, value in parts.items()},
        **calibration.situation_columns(mine.realised, mine.situations),
        "compared": [
            {name: value for name, value in asdict(one).items() if not name.startswith("curve")}
            for one in found
        ],
    }


def _score_lines(mine: Promises, found: Sequence[Compared], parts: dict[str, float]) -> Iterator[object]:

    yield textwrap.fill(
        f"{mine.name}: {len(mine.missions)} plans, fidelity={mine.fidelity}; promised "
        f"{probability_text(float(mine.promised.mean()))} in {Settings.preset(mine.fidelity).law} winds, "
        f"failed {probability_text(float(mine.realised.mean()))} in the later fields",
        80,
    )
    yield ", ".join(f"{name} {value:.3f}" for name, value in parts.items())
    rows = [
        (
            one.name, f"{one.missions}", f"{one.brier:.3f}", f"{one.mean:+.3f}", _ends(one.low, one.high),
            "-" if math.isnan(one.p_value) else f"{one.p_value:.2g}",
            _ends(one.situation_low, one.situation_high),
        )
        for one in found
    ]  # fmt: skip
    header = ("against", "n", "Brier", "change", "95 %", "p", "95 %, situations")
    yield shown_table(header, rows, left=("against",))
    n = found[0].situations
    yield textwrap.fill(
        f"n: missions that both planned; change: Brier score of {mine.name} minus the other, with the test "
        f"of Diebold and Mariano. Weather situations: {n}; the last column has one situation as one trial. "
        f"No calibrated rate below 1/({n} + 1) = {probability_text(1 / (n + 1))} can be claimed.",
        80,
    )


def _ends(low: float, high: float) -> str:
    return f"{low:+.3f} to {high:+.3f}" if math.isfinite(low) and math.isfinite(high) else "-"
