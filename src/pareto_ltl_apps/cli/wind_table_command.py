"""``pareto-ltl wind-error`` for tables of forecasts by run, place and lead: estimate a law, and check one."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from pareto_ltl.support.errors import ConfigError
from pareto_ltl.support.levels import wind_level
from pareto_ltl_apps.cli.output import Answer

if TYPE_CHECKING:
    from pareto_ltl.extend import LawOfParts
    from pareto_ltl_apps.wind_errors.law_check import CheckRow
    from pareto_ltl_apps.wind_errors.law_estimate import LawEstimate


def check_table(options: Namespace) -> Answer:
    """The answer of ``--check TABLE --law LAW``: how often errors stay within the intervals of the law."""
    if options.check is None or options.law is None:
        missing = "--law" if options.law is None else "--check TABLE"
        raise ConfigError(f"--check TABLE and --law LAW belong together; {missing} is missing")
    if options.folder is not None:
        raise ConfigError(f"{options.folder}: --check estimates nothing; leave the name out")
    from pareto_ltl_apps.wind_errors.law_check import check_document, check_law, spread_note
    from pareto_ltl_apps.wind_errors.point_tables import read_point_table

    wind_level(options.level, "--level")
    law = _law(options.law)
    table = read_point_table(options.check)
    measured, law = law, law.for_winds(options.level, table.spread)
    found, rows = check_law(table, law)
    document = check_document(table, law, found, rows)
    scaled = (
        None
        if law is measured
        else f"the law is for {measured.level}; for {law.level} it is scaled by "
        f"{law.spread / measured.spread:.2f}, the ratio of the spreads of the winds"
    )
    notes = [note for note in (*table.notes, scaled, spread_note(table, law)) if note]
    n = document["n"]
    if n < 10:
        notes.append(f"{n} situations only: shares of so few say little")
    verifies = (
        "newer runs verify the table; the lasting part of the law is left out, which they cannot show"
        if found.truth == "own"
        else "observations verify the table"
    )
    lines = [
        f"{table.name} against the law {law.name}: {n} situations, floor 1/{n + 1}; {verifies}",
        *check_lines(rows),
        *(f"note: {note}" for note in notes),
    ]
    return Answer(document | {"notes": notes}, lines)


def _law(name: str) -> LawOfParts:
    from pareto_ltl.extend import law_of_parts_named, packaged_laws

    if name not in packaged_laws() and not Path(name).expanduser().is_file():
        raise ConfigError(
            f"--law {name}: no packaged law of parts and no file; name a file, or one of "
            f"{', '.join(packaged_laws())}"
        )
    return law_of_parts_named(name)


def check_lines(rows: Sequence[CheckRow]) -> Iterator[str]:
    """A table: shares within the intervals for 50, 90, 99 and 99.9 %."""
    yield f"{'':<22}{'50 %':>7}{'90 %':>7}{'99 %':>8}{'99.9 %':>8}{'rms z':>7}{'s':>6}{'n':>6}"
    for row in rows:
        c50, c90, c99, c999 = (100 * share for share in row.covered)
        answer = row.document()
        yield (
            f"{f'{row.kind} {row.hours:g} h':<22}{c50:>7.1f}{c90:>7.1f}{c99:>8.2f}{c999:>8.2f}"
            f"{answer['rms_z']:>7.2f}{row.tail:>6.2f}{answer['n']:>6}"
        )


def estimate_from_table(options: Namespace) -> Answer:
    """Estimate a law of parts; write it, its figure and its page."""
    for name in ("area", "block"):
        if getattr(options, name) is not None:
            raise ConfigError(f"--{name} is for folders of GRIB files, not for a table; leave it out")
    if options.stations:
        raise ConfigError(
            "--stations is for folders of GRIB files; give observations as columns of the table"
        )
    from careful_io.files import write_json
    from careful_io.fingerprints import file_fingerprint
    from pareto_ltl_apps.cli.wind_error_command import LONGEST_NAME, check_out
    from pareto_ltl_apps.view.wind_law import write_law_page
    from pareto_ltl_apps.wind_errors.law_estimate import estimate_law
    from pareto_ltl_apps.wind_errors.point_tables import read_point_table

    check_out(options.out, options.folder)
    wind_level(options.level, "--level")
    table = read_point_table(options.folder)
    name = options.name or options.folder.name.partition(".")[0][:LONGEST_NAME]
    estimate = estimate_law(table, name, options.level, options.seed)
    document = estimate.law.document() | {"files": {table.name: file_fingerprint(options.folder)}}
    write_json(options.out, document)
    written = (options.out, *write_law_page(options.out.parent, options.out.stem, estimate))
    lines = [*estimate_lines(estimate), f"wrote {', '.join(map(str, written))}"]
    return Answer({**document, "notes": estimate.notes, "written": written}, lines, written)


def estimate_lines(estimate: LawEstimate) -> Iterator[str]:
    """Lines of text: the parts, numbers with intervals, coverage of situations left out, remarks."""
    from pareto_ltl_apps.wind_errors.law_estimate import law_numbers

    law = estimate.law
    yield (
        f"{law.name}: {law.situations} situations (dates two days apart), floor 1/{law.situations + 1}; "
        f"verified by {'observations' if law.truth == 'observed' else 'newer runs'}"
    )
    yield f"{'part':<10}{'sd at 6, 24, 48 h [m/s]':<26}{'memory at 24 h':<16}length"
    for part in law.parts:
        sd, lasts, length = part.words()
        yield f"{part.name:<10}{sd:<26}{lasts:<16}{length}"
    for what, value in law_numbers(law).items():
        low, high = law.intervals[what]
        yield f"{what:<28}{value:.2f} (95 %: {low:.2f} to {high:.2f})"
    if estimate.left_out:
        yield "situations left out in turn:"
        yield from check_lines([left.row for left in estimate.left_out])
    for note in estimate.notes:
        yield note if note.startswith("WARNING") else f"note: {note}"
