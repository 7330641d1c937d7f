"""``pareto-ltl contain`` from end to end: its files, what ``verify`` derives again, and what it refuses."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

import pareto_ltl
from careful_io.reading import read_json
from lies.editing import in_json
from pareto_ltl.extend import Frame
from pareto_ltl_apps.cli.commands import run_command_line
from pareto_ltl_verify.claims.containment import CLAIMS, WORDS
from pareto_ltl_verify.evidence import open_evidence
from pareto_ltl_verify.judge import findings
from quick_plan import QUICK_PLAN
from quick_wind import QUICK_WIND

SMALL = {
    **QUICK_PLAN,
    "exports": {"files": False},
    "report": {"figures": False, "page": False},
    "wind": {**QUICK_WIND, "modes_max": 8},
}
FILE = "containment/containment.json"
Edit = Callable[[dict[str, Any]], Any]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small result, with its containment."""
    place = tmp_path_factory.mktemp("contain") / "made"
    pareto_ltl.plan("phi1", "F(a & F b & F c)", out=place, **SMALL)
    words = ["contain", str(place), "--corridor", "150km", "--between", "100", "220", "--flights", "4000"]
    assert run_command_line(words) == 0
    return place


def claims_of(place: Path) -> dict[str, bool]:
    return {found.claim: found.holds for found in findings(open_evidence(place), CLAIMS)}


def test_every_file_is_written_and_every_claim_holds(made: Path) -> None:
    names = {path.name for path in (made / "containment").iterdir()}
    intents = {f"operational_intent_{level}.json" for level in ("1e-2", "1e-3", "1e-4")}
    files = {"containment.json", "containment.txt", "containment.png", "volumes.geojson", "volumes.kml"}
    assert names == files | intents
    claims = claims_of(made)
    assert len(claims) == len(CLAIMS)
    assert all(claims.values()), claims


def test_the_document_says_what_is_not_in_it_and_uses_no_word_of_approval(made: Path) -> None:
    text = (made / "containment" / "containment.txt").read_text() + (made / FILE).read_text()
    assert not any(word in text.lower() for word in WORDS)
    assert "Not in these figures: failures of engine" in text
    stated = read_json(made / FILE)
    assert [area["name"] for area in stated["areas"]] == ["border", "corridor of 150.0 km"]
    assert [level["per_hour"] for level in stated["levels"]] == [1e-2, 1e-3, 1e-4]
    hours = stated["hours"]
    for level in stated["levels"]:
        assert level["left"]["per_hour"]["rate"] == pytest.approx(level["left"]["rate"] / hours)


def test_an_intent_has_the_corners_and_times_of_the_volumes(made: Path) -> None:
    stated = read_json(made / "containment" / "operational_intent_1e-3.json")["volumes"]
    level = read_json(made / FILE)["levels"][1]
    crs = read_json(made / "scene.json")["crs"]
    assert len(stated) == len(level["volumes"])
    for one, volume in zip(stated, level["volumes"], strict=True):
        vertices = one["volume"]["outline_polygon"]["vertices"]
        places = Frame(crs).to_plane(*(np.array([v[key] for v in vertices]) for key in ("lng", "lat")))
        np.testing.assert_allclose(places, volume["corners_m"], atol=0.01)
        assert one["time_start"]["value"] < one["time_end"]["value"]
        assert one["volume"]["altitude_lower"] == {"value": 100.0, "reference": "W84", "units": "M"}


def test_the_own_intent_is_left_as_often_as_the_volumes(made: Path, tmp_path: Path) -> None:
    intent = made / "containment" / "operational_intent_1e-2.json"
    words = ["contain", str(made), "--volume", str(intent), "--levels", "1e-2", "--flights", "4000"]
    assert run_command_line([*words, "--out", str(tmp_path / "out")]) == 0
    volume = read_json(tmp_path / "out" / "containment.json")["areas"][1]
    level = read_json(made / FILE)["levels"][0]
    # an area that is active at some time of a step may be used in all of it, and both ends are in it
    assert volume["left"]["rate"] == pytest.approx(level["left"]["rate"], rel=0.05)


def test_a_drawn_area_is_a_volume_without_times(made: Path, tmp_path: Path) -> None:
    scene = read_json(made / "scene.json")
    (west, south), (east, north) = scene["bounds"]
    lon, lat = Frame(scene["crs"]).to_geographic(
        np.array([[west, south], [east, south], [east, north], [west, north], [west, south]])
    )
    ring = np.column_stack([lon, lat]).tolist()
    path = tmp_path / "border.geojson"
    path.write_text(json.dumps({"type": "Polygon", "coordinates": [ring]}))
    found = pareto_ltl.contain(made, volume=path, levels=[1e-2], flights=4000)
    (_, border), (area, drawn) = found.areas
    assert area.name == "volume border.geojson"
    assert abs(border.failure - drawn.failure) < 2e-3
    assert shapely.area(area.within[0]) == pytest.approx((east - west) * (north - south), rel=0.02)


# --- falsified results ------------------------------------------------------------------------


def level(number: int) -> Callable[[dict[str, Any]], Any]:
    return lambda stated: stated["levels"][number]


def tighter(stated: dict[str, Any]) -> None:
    """Volumes of a lower level under the name of the next, whose size is as stated there."""
    loose, tight = stated["levels"][:2]
    for key in ("volumes", "volume_time_m2_s"):
        tight[key] = loose[key]
    tight["share_of_buffer"] = tight["volume_time_m2_s"] / tight["buffer"]["volume_time_m2_s"]


def half_as_often(stated: dict[str, Any]) -> None:
    for rate in (stated["areas"][1]["left"], stated["levels"][0]["left"]):
        for numbers in (rate, rate["per_hour"]):
            numbers.update({end: 0.5 * numbers[end] for end in ("low", "rate", "high")})


LEFT, AREAS = (
    "containment: volumes are left as seldom as claimed",
    "containment: border, corridors and given volumes",
)
RECORD, SIZE = "containment: plan, law, hours and floor", "containment: volumes and their size"
LIES: list[tuple[str, Edit, tuple[str, ...]]] = [
    (
        "the volumes are too small",
        tighter,
        (LEFT, "containment: volumes.geojson", "containment: volumes.kml"),
    ),
    ("half as many leave", half_as_often, (LEFT, AREAS)),
    ("the flight is longer", lambda s: s.update(hours=2.0 * s["hours"]), (RECORD,)),
    ("the law has a floor", lambda s: s.update(floor=0.1), (RECORD,)),
    ("nothing is left out", lambda s: s.update(not_covered=[]), (RECORD,)),
    ("a word of approval", lambda s: s["skipped"].append(f"this is {WORDS[0]}"), (RECORD,)),
    ("a smaller buffer", lambda s: s["levels"][1]["buffer"].update(radius_m=1.0), (SIZE, LEFT)),
    ("less area and time", lambda s: s["levels"][1].update(volume_time_m2_s=1.0), (SIZE,)),
    ("a leg later", lambda s: s["levels"][0]["volumes"][1].update(start_s=0.0), (SIZE,)),
    ("per hour", lambda s: s["levels"][0]["left"]["per_hour"].update(rate=1e-9), (RECORD,)),
    ("a larger share allowed", lambda s: s["levels"][0].update(in_all=0.9), (RECORD,)),
]


@pytest.mark.parametrize(("name", "edit", "caught"), LIES, ids=[lie[0] for lie in LIES])
def test_a_lie_is_caught(name: str, edit: Edit, caught: tuple[str, ...], made: Path, tmp_path: Path) -> None:
    place = shutil.copytree(made, tmp_path / "lie")
    in_json(FILE, edit)(place)
    named = [claim for claim in CLAIMS if claim.name in caught]
    assert len(named) == len(caught)
    for found in findings(open_evidence(place), named):
        assert not found.holds, found


def test_a_containment_of_another_plan_is_caught(made: Path, tmp_path: Path) -> None:
    place = shutil.copytree(made, tmp_path / "other")
    plan = place / "plan.json"
    plan.write_text(plan.read_text() + "\n")
    (found,) = findings(open_evidence(place), [claim for claim in CLAIMS if claim.name == RECORD])
    assert not found.holds


# --- what is refused --------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--levels", "2"], "levels must be 1e-6 to 0.1 per flight hour, got 2"),
        (["--corridor", "0km"], "--corridor must be a length in m, km or nmi"),
        (["--flights", "5"], "flights must be 1,000 to 1,000,000, got 5"),
        (["--between", "200", "100"], "--between needs a lower and a higher height"),
        (["--volume", "absent.geojson"], "absent.geojson: cannot be read"),
        (["--volume", "EMPTY"], "holds no area; give a GeoJSON file"),
        (["--volume", "CROSSED"], "an area is not a simple polygon"),
        (["--volume", "SHORT"], "no area is active"),
        (["--volume", "ODD"], "not as expected"),
    ],
)
def test_bad_input_is_one_line(
    words: list[str], said: str, made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    bow = {"type": "Polygon", "coordinates": [[[-95, 36], [-94, 37], [-94, 36], [-95, 37], [-95, 36]]]}
    box = {"type": "Polygon", "coordinates": [[[-99, 30], [-80, 30], [-80, 45], [-99, 45], [-99, 30]]]}
    times = {"time_start": "2018-10-09T00:00:00Z", "time_end": "2018-10-09T02:00:00Z"}
    contents = {
        "EMPTY": {"type": "FeatureCollection", "features": []},
        "CROSSED": bow,
        "SHORT": {"type": "Feature", "properties": times, "geometry": box},
        "ODD": {"type": "Polygon", "coordinates": 7},
    }
    for name, content in contents.items():
        (tmp_path / name).write_text(json.dumps(content))
    assert run_command_line(["contain", str(made), *words]) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    assert said in lines[0]
