"""Make missions, plan each with several seeds, and judge the runs; words such as planner.trees=20 go to all.

Finished runs are in OUT/rows.jsonl and are not repeated. The page of results is OUT/index.html.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from corpus import missions as made_missions
from corpus.judging import judge, summary
from corpus.page import write_page
from corpus.running import VARIANTS, prepare, read_rows, read_tags, run_all, tasks, unit_seconds

FOLDER = Path(__file__).parents[2] / "outputs" / "corpus"


def arguments(argv: list[str] | None = None) -> argparse.Namespace:
    """The command line; seeds and names are lists."""
    parser = argparse.ArgumentParser(prog="make corpus", description=__doc__)
    parser.add_argument("words", nargs="*", help="settings for every run")
    parser.add_argument("--count", type=int, default=100, help="number of missions")
    parser.add_argument("--seed", type=int, default=0, help="seed of the missions")
    parser.add_argument("--seeds", default="0,1,2,3,4", help="seeds of the runs of each mission")
    parser.add_argument("--only", default="", help="names of missions, with commas")
    parser.add_argument("--tenth", action="store_true", help="one mission of every kind instead of COUNT")
    parser.add_argument("--landmarks", type=int, help="landmarks of every map, all without position feedback")
    parser.add_argument("--variants", default="full,quick,bare", help=f"of {', '.join(VARIANTS)}")
    parser.add_argument("--limit", type=float, default=600.0, help="seconds after which a run is stopped")
    parser.add_argument("--jobs", type=int, default=1, choices=(1, 2), help="runs at the same time")
    parser.add_argument(
        "--no-unit", dest="unit", action="store_false", help="do not measure phi2, the unit of time"
    )
    parser.add_argument("--out", type=Path, default=FOLDER, help="folder of missions, runs and results")
    asked = parser.parse_intermixed_args(argv)
    asked.seeds = [int(seed) for seed in asked.seeds.split(",")]
    asked.only = [name for name in asked.only.split(",") if name]
    asked.variants = asked.variants.split(",")
    if unknown := set(asked.variants) - set(VARIANTS):
        parser.error(
            f"--variants: unknown {', '.join(sorted(unknown))}; expected some of {', '.join(VARIANTS)}"
        )
    return asked


def main() -> int:
    """Run what is not finished, judge all runs of the folder; 1 if one ended with an internal error."""
    asked = arguments()
    out = asked.out.resolve()
    chosen = (
        made_missions.tenth(asked.seed)
        if asked.tenth
        else made_missions.missions(asked.count, asked.seed, asked.landmarks)
    )
    if left := made_missions.left_out():
        print(
            f"left out, since the NOAA files are not beside this checkout: missions of kind {', '.join(left)}"
        )
    chosen = [mission for mission in chosen if not asked.only or mission.name in asked.only]
    drawn = {"seed": asked.seed, "tenth": asked.tenth, "landmarks": asked.landmarks}
    prepare(chosen, out, {**drawn, "words": asked.words})
    unit = unit_seconds(out, asked.words, asked.limit) if asked.unit else None
    run_all(tasks(chosen, asked.seeds, asked.variants), out, asked)
    judged = judge(read_rows(out), read_tags(out))
    for goal in summary(judged, unit):
        print(f"{goal.text}: {goal.value}{' (MISSED)' if goal.met is False else ''}")
    print(f"page: {write_page(judged, out, unit, asked.words)}")
    return int(any(row["code"] == 1 for row in read_rows(out)))


if __name__ == "__main__":
    sys.exit(main())
