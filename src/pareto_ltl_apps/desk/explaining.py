"""Formulas in words and as drawings, made in a second process, since an automaton can take seconds.

``python -m pareto_ltl_apps.desk.explaining`` answers each line of JSON with one. The newest request is
answered first. If the client of the present one goes, the process ends, and a new one answers the next.
"""

from __future__ import annotations

import asyncio
import json
import signal
import sys
from asyncio.subprocess import PIPE, Process
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

from pareto_ltl import Settings
from pareto_ltl.extend import MissionConfig, disputed_reading, formula_of, parse_formula, translate
from pareto_ltl.support.errors import ParetoLtlError
from pareto_ltl_apps.view.in_words import mission_in_words
from pareto_ltl_apps.view.page.machine import shown_automaton

PROCESS = (sys.executable, "-m", "pareto_ltl_apps.desk.explaining")
MAX_TIME = 20.0  # [s] for one formula
LATE = (
    f"the automaton of this mission is not made within {MAX_TIME:g} s: use fewer goals or a shorter formula"
)
ENDED = "the process that explains formulas ended early; change the formula, or try again"
KEPT = 200  # answers in memory
MAX_LINE = 2**24  # bytes of an answer
MAX_STATES = 500  # of an automaton


@dataclass(slots=True)
class Explainer:
    """The process, the requests that wait for it, and its last answers."""

    answers: dict[str, Any] = field(default_factory=dict)
    waiting: list[tuple[str, asyncio.Future[Any]]] = field(default_factory=list)
    process: Process | None = None
    working: asyncio.Task[None] | None = None

    async def explained(self, requested: Mapping[str, Any]) -> Any:
        """The answer of :func:`explained_formula`; the work on it ends if the caller is cancelled."""
        text = json.dumps(requested, sort_keys=True)
        if text in self.answers:
            return self.answers[text]
        answer: asyncio.Future[Any] = asyncio.get_running_loop().create_future()
        self.waiting.append((text, answer))
        if self.working is None or self.working.done():
            self.working = asyncio.create_task(self._work())
        try:
            return await answer
        finally:
            answer.cancel()

    async def start(self) -> None:
        """Start the process, which needs a second to import what it uses."""
        with suppress(OSError):
            await self._started()

    async def close(self) -> None:
        """End the process."""
        if self.working is not None:
            self.working.cancel()
            with suppress(asyncio.CancelledError):
                await self.working
        await self._end_process()

    async def _work(self) -> None:
        """Answer all requests that wait, the newest first."""
        while self.waiting:
            text, answer = self.waiting.pop()
            if answer.done():
                continue
            made = asyncio.ensure_future(self._made(text))
            await asyncio.wait({made, answer}, timeout=MAX_TIME, return_when=asyncio.FIRST_COMPLETED)
            found = made.result() if made.done() else None
            if found is not None:
                self.answers = dict([*self.answers.items()][1 - KEPT :]) | {text: found}
            else:
                found = {"formula": "", "column": None, "error": ENDED if made.done() else LATE}
                made.cancel()
                await self._end_process()
            if not answer.done():
                answer.set_result(found)

    async def _made(self, text: str) -> Any:
        """The answer of the process; None if it ended."""
        process = await self._started()
        assert process.stdin is not None
        assert process.stdout is not None
        with suppress(ConnectionError):
            process.stdin.write(text.encode() + b"\n")
            await process.stdin.drain()
        line = await process.stdout.readline()
        return json.loads(line) if line else None

    async def _started(self) -> Process:
        if self.process is None or self.process.returncode is not None:
            self.process = await asyncio.create_subprocess_exec(
                *PROCESS, stdin=PIPE, stdout=PIPE, limit=MAX_LINE
            )
        return self.process

    async def _end_process(self) -> None:
        if self.process is not None:
            with suppress(ProcessLookupError):
                self.process.kill()
            await self.process.wait()
            self.process = None


def explained_formula(requested: Mapping[str, Any]) -> dict[str, Any]:
    """A formula, or the formula of a pattern, in words and as an automaton; or its error and its column."""
    text = ""
    try:
        mission = Settings.of_section("mission", {key: value for key, value in requested.items() if value})
        assert isinstance(mission, MissionConfig)
        text = formula_of(mission)
        tree = parse_formula(text)
        automaton = translate(text, None, MAX_STATES)
    except ParetoLtlError as error:
        return {"formula": text, "error": str(error), "column": getattr(error, "column", None)}
    return {
        "formula": text,
        "words": mission_in_words(text),
        "note": disputed_reading(text),
        "names": sorted(tree.atoms),
        "states": automaton.n_states,
        "impossible": bool(automaton.contradiction),
        "automaton": shown_automaton(automaton),
        "error": None,
    }


def main() -> None:
    """Answer the lines of the standard input until it ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C ends the server, and that ends the input
    for line in sys.stdin:
        print(json.dumps(explained_formula(json.loads(line))), flush=True)


if __name__ == "__main__":
    main()
