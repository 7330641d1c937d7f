"""``pareto-ltl beacons DIR``: where a beacon would reduce the failure of a plan most."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from pareto_ltl.cli.arguments import CommandArguments
from pareto_ltl.cli.output import Answer


def beacons_command(argv: Sequence[str]) -> Answer:
    """The best places for beacons; writes table and figure."""
    parser = CommandArguments(
        prog="pareto-ltl beacons",
        description="Find the places along and beside the plan of DIR where a beacon, within whose radius "
        "the robot measures its position, reduces the failure most. The plan stays as it is: plan again with "
        "the beacon on the map to use it fully. Writes beacons.csv, beacons.txt and beacons.png.",
    )
    parser.add_result()
    parser.add_argument("--radius", type=float, metavar="M", help="of a beacon [m]; default: 2 %% of the map")
    parser.add_argument("--number", type=int, default=1, metavar="N", help="beacons to place, 1 to 3")
    parser.add_argument("--flights", type=int, default=2000, metavar="N", help="flights that compare places")
    parser.add_argument("--out", type=Path, metavar="FOLDER", help="default: the folder beacons in DIR")
    options = parser.parse_args(argv)
    from pareto_ltl.run.beacons import beacon_document, beacon_lines, beacons, write_beacons
    from pareto_ltl.run.results import PlanningResult, planned_run

    run = planned_run(options.directory)
    found = beacons(
        PlanningResult(run), radius=options.radius, number=options.number, flights=options.flights
    )
    folder = options.out or options.directory / "beacons"
    write_beacons(run, found, folder)
    lines = [*beacon_lines(run, found), f"table and figure in {folder}"]
    return Answer({"directory": folder, **beacon_document(run, found)}, lines, [folder])
