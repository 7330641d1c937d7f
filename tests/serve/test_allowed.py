"""What a request may set: nothing outside of the folder is read, and nothing connects."""

from __future__ import annotations

import os
import re
import socket
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from hydra.core.override_parser.overrides_parser import OverridesParser

from declared_settings import Declaration
from desk import SMALL, DirectClient
from pareto_ltl.settings import Settings
from pareto_ltl.support.errors import ConfigError, ParetoLtlError
from pareto_ltl_apps.cli.desk_worker import run_at_desk
from pareto_ltl_apps.cli.hydra_app import run_accepted
from pareto_ltl_apps.desk.allowed import PATHS, SECTIONS, TEXTS, Leaf, check_composed, leaves, quoted
from pareto_ltl_apps.desk.app import desk_app
from pareto_ltl_apps.desk.folder import DeskFolder
from pareto_ltl_apps.desk.missions import COMMANDS, EXAMPLES, command_words

CANARY = "canary line: 7f3a9c"
TOKEN, PORT = "a-token-of-this-test", 8123
HERE, BEARER = f"http://127.0.0.1:{PORT}", {"Authorization": f"Bearer {TOKEN}"}
WATCHED: list[tuple[str, str]] = []  # file or address, while a test watches
OPENING = {"open", "os.listdir", "os.scandir", "os.open", "socket.connect", "socket.getaddrinfo"}
WATCHES: list[bool] = []


def _watch(event: str, given: tuple[Any, ...]) -> None:
    if WATCHES and event in OPENING:
        WATCHED.append((event, str(given)))


sys.addaudithook(_watch)  # it cannot be removed again


@contextmanager
def watched() -> Iterator[list[tuple[str, str]]]:
    """All files that are opened and all connections that are tried."""
    WATCHED.clear()
    WATCHES.append(True)
    try:
        yield WATCHED
    finally:
        WATCHES.clear()


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a desk, which has links to another folder, and with that folder."""
    place = tmp_path_factory.mktemp("place")
    (place / "outside" / "20260101-000000-abcd").mkdir(parents=True)
    for name in ("canary.csv", "canary.geojson", "canary.hoa", "front.npz", "20260101-000000-abcd/run.json"):
        (place / "outside" / name).write_text(f"{CANARY}\n{CANARY}\n")
    desk = DeskFolder.opened(place / "desk").root
    (desk / "winds").mkdir()
    (desk / "winds" / "mine.csv").write_text("time,lat,lon,u,v\n")
    (desk / "link").symlink_to(place / "outside")
    (desk / "linked").mkdir()
    (desk / "linked" / "canary.csv").symlink_to(place / "outside" / "canary.csv")
    (desk / "plans").mkdir()
    (desk / "plans" / "20260101-000000-abcd").symlink_to(place / "outside" / "20260101-000000-abcd")
    return place


@pytest.fixture(scope="module")
def listener() -> Iterator[socket.socket]:
    """A port to which nothing may connect."""
    with socket.create_server(("127.0.0.1", 0)) as listening:
        listening.setblocking(False)
        yield listening
        with pytest.raises(BlockingIOError):
            listening.accept()


def hostile(place: Path, port: int) -> list[str]:
    """Values that lead out of the desk of ``place``, or to ``port``, in all forms that we know of."""
    out = str(place / "outside" / "canary.csv")
    up = "../outside/canary.csv"
    home = os.path.relpath(out, Path.home())
    return [
        out, up, f"winds/../{up}", "link/canary.csv", "linked", "linked/canary.csv", "link", "link/*",
        "lin*/*.csv", "**/*.csv", "l*/../*", str(place / "outside"), f"~/{home}", f"./~/{home}",
        f"winds/../~/{home}", f"/proc/self/cwd/{up}", f"str({out})", f"str('{out}')", f"int({out})",
        f"json_str({out})", f"choice({out},{up})", f"glob(*,{out})", f"extend_list({out})", f"shuffle({out})",
        f"'{out}'", f'"{up}"', f"[{out}]", f"['{out}','{up}']", f"{{path: {out}}}",
        f"{{_target_: os.system, command: 'cat {out}'}}", f"{out},{up}", f"&a [{out}, *a]",
        f"!!python/object/apply:os.system ['cat {out}']", "${oc.env:HOME}", "${oc.env:HOME}/canary.csv",
        "${now:%Y}", "${hydra:runtime.cwd}", f"\\${{oc.env:HOME}}{out}", f"file://{out}",
        f"http://127.0.0.1:{port}/canary.csv", f"https://127.0.0.1:{port}/", f"tcp://127.0.0.1:{port}",
        f"127.0.0.1:{port}", f"//127.0.0.1:{port}/share", f"{out}\0.csv", f"winds/mine.csv\n{out}", "\ud800",
        f"/vsicurl/http://127.0.0.1:{port}/x", "???", "",
    ]  # fmt: skip


def requests_with(key: str, value: str) -> Iterator[dict[str, Any]]:
    """Bodies of a request that set ``key`` to ``value``."""
    for sign in ("", "+", "++", "~"):
        yield {"overrides": [f"{sign}{key}={value}"]}
    for held in (value, [value], {"path": value}, [[value]], {"path": [value]}):
        yield {"settings": {key: held}}


@pytest.mark.parametrize("key", [*leaves(), *(f"{key}.x" for key in leaves()), "wind.url", "hydra.run.dir"])
def test_no_setting_leads_out_of_the_folder(place: Path, listener: socket.socket, key: str) -> None:
    folder = DeskFolder(place / "desk")
    parser = OverridesParser.create()
    for value in hostile(place, listener.getsockname()[1]):
        for request in requests_with(key, value):
            with watched() as seen:
                try:
                    words = command_words(folder, {**request, "command": "plan"})
                except ParetoLtlError as error:
                    assert CANARY not in str(error)
                    words = []
            assert [entry for entry in seen if "canary" in entry[1] or "socket" in entry[0]] == []
            for override in parser.parse_overrides(words[1:]):
                assert not override.is_sweep_override()
                assert key.removesuffix(".x") in TEXTS, words
                shape = r"[\w.+]+=[][{},:\w.]*"  # no function, no substitution
                assert re.fullmatch(shape, bare(words[1])), words
                assert "${" not in words[1]
                assert "_target_" not in bare(words[1])


def bare(word: str) -> str:
    """What a word of a command line has outside of quotes."""
    return re.sub(r"'(?:[^'\\]|\\.)*'", "", word, flags=re.DOTALL)


@pytest.mark.parametrize("key", sorted(TEXTS))
def test_a_text_is_not_taken_for_a_path(
    place: Path, key: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """What a request may set to any text, set to a path: the run opens nothing there."""
    out, folder = str(place / "outside" / "canary.csv"), DeskFolder(place / "desk")
    kind = str(leaves()[key].kind)
    listed = [[out]] if "list[list" in kind else [out] if "list" in kind else out
    settings: dict[str, Any] = {"experiment": "hop", key: {"x": out} if "dict" in kind else listed}
    if key in ("mission.goals", "mission.avoid", "mission.order"):
        settings |= {"mission.formula": "", "mission.pattern": "sequence"}  # which reads them
    command = "plan" if key.startswith("mission") else "departure" if key.startswith("departure") else "wind"
    try:
        words = command_words(folder, {"overrides": SMALL, "settings": settings, "command": command})
    except ConfigError:
        return
    monkeypatch.chdir(folder.root)
    with watched() as seen:
        run_at_desk([*words, f"hydra.run.dir=plans/{key}"])
    said = capsys.readouterr()
    assert CANARY not in said.out + said.err
    assert [entry for entry in seen if "canary" in entry[1] or entry[0] == "socket.connect"] == []


@pytest.mark.parametrize("sign", ["", "+", "++"])
@pytest.mark.parametrize(
    "word",
    [
        "wind.path=str({})", "scene.file=str({})", "wind.forecast_error=str({})", "wind.path=[{}]",
        "mission.automaton=str({})", "evaluation.resume=str({})", "evaluation.cluster=127.0.0.1:9",
        "wind.base_url=http://127.0.0.1:9", "scene.file={}", "scene.file=../outside/canary.geojson",
        "selection.extra_paths=link", "experiment=../../outside", "hydra.run.dir=/tmp/elsewhere",
        "hydra/launcher=joblib", "pipelines=compare", "pipelines.stages=[readings]", "ingest.out={}",
        "mission.formula=${{oc.env:HOME}}", "name=../outside", "wind=[sample,calm]", "wind=/etc/passwd",
        "robot={{dt: 60}}", "experiment=phi1,phi2", "seed=range(0,3)", "robot@scene=multirotor",
        "experiment=null", "wind=null", "planner.trees=nan", "planner.epsilon=inf", "robot.dt=str(auto)",
        "exports.altitude=1e400", "seed=" + "9" * 5000, "scene.regions._target_=[[0,0]]", "sweep=seeds",
        "ingest=conus", "forecast_test.truth={}", "hindcast.truth=link",
    ],
)  # fmt: skip
def test_the_server_refuses_what_leads_out(place: Path, word: str, sign: str) -> None:
    client = DirectClient(desk_app(DeskFolder(place / "desk"), TOKEN, PORT), HERE)
    word = word.format(place / "outside" / "canary.csv")
    answer = client.post(
        "/api/plans", json={"overrides": ["+experiment=hop", f"{sign}{word}"]}, headers=BEARER
    )
    assert answer.status_code == 400, answer.text
    assert CANARY not in answer.text
    assert "\n" not in answer.json()["error"]
    assert not (place / "desk" / "maps").exists()


@pytest.mark.parametrize(
    "word", ["--config-dir=/tmp", "-cd", "compare", "-m", "~wind", "=", "x", "++", "a b=c"]
)
def test_flags_and_commands_are_no_settings(place: Path, word: str) -> None:
    with pytest.raises(ConfigError):
        command_words(DeskFolder(place / "desk"), {"overrides": ["+experiment=hop", word]})


def test_a_plan_that_is_a_link_is_no_plan(place: Path) -> None:
    client = DirectClient(desk_app(DeskFolder(place / "desk"), TOKEN, PORT), HERE)
    answer = client.get("/api/plans/20260101-000000-abcd", headers=BEARER)
    assert answer.status_code == 404
    assert CANARY not in answer.text
    assert client.get("/api/plans", headers=BEARER).json() == {"plans": []}


# --- a setting is closed unless it is opened ------------------------------------------------------------


def test_a_new_text_is_closed_and_a_new_number_is_open() -> None:
    for kind in (str, str | None, list[str], dict[str, Any], Any, list[Any]):
        assert not Leaf("wind.new", kind, Declaration("a file")).open
        assert not Leaf("new", kind, Declaration("a file")).open
    for kind in (int, float, bool, float | None, list[float], list[int] | None):
        assert Leaf("robot.airspeed_sd", kind, Declaration("a number")).open
        assert not Leaf("evaluation.new", kind, Declaration("a number")).open
    assert Leaf("wind.new", str, Declaration("a word", choices=("a", "b"))).open
    assert Leaf("wind.new", Any, Declaration("a number or a word", words=("auto",))).open


def test_the_tables_name_settings_that_exist() -> None:
    assert set(leaves()) >= TEXTS | set(PATHS)
    assert not TEXTS & set(PATHS)
    sections = {key.rpartition(".")[0] for key in leaves()}
    assert set(SECTIONS) <= sections
    closed = {key for key, leaf in leaves().items() if not leaf.open}
    assert closed >= {
        "name", "wind.base_url", "evaluation.cluster", "evaluation.resume", "evaluation.jobs", "ingest.out",
        "pipelines.stages", "forecast_test.truth", "hindcast.truth", "selection.options", "sweep.x",
    }  # fmt: skip


# --- what is accepted -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("word", "key", "value"),
    [
        ("planner.trees=3", "planner.trees", 3),
        ("robot.u_max=25", "robot.u_max", 25.0),
        ("selection.weights=[1,1,2]", "selection.weights", [1.0, 1.0, 2.0]),
        ("robot.dt=auto", "robot.dt", "auto"),
        ("robot.dt=1e2", "robot.dt", 100.0),
        ("robot.level=null", "robot.level", None),
        ("planner.epsilon=null", "planner.epsilon", None),
        ("report.figures=false", "report.figures", False),
        ("mission.formula=F(a & F b)", "mission.formula", "F(a & F b)"),
        ("mission.formula='F(a & F[0,6h] b)'", "mission.formula", "F(a & F[0,6h] b)"),
        ("mission.start_time=2018-10-09T06:00:00Z", "mission.start_time", "2018-10-09T06:00:00Z"),
        ("departure.starts=[2018-10-09T06:00:00Z, 2018-10-09T09:00:00Z]", "departure.starts",
         ["2018-10-09T06:00:00Z", "2018-10-09T09:00:00Z"]),
        ("mission.order=[[a, b]]", "mission.order", [["a", "b"]]),
        ("mission.goals=['1', b]", "mission.goals", ["1", "b"]),
        ("report.formats=[png,svg]", "report.formats", ["png", "svg"]),
        ("scene.windows={a_late: {region: a, from: 6h}}", "scene.windows",
         {"a_late": {"region": "a", "from": "6h"}}),
        ("+scene.regions.c=[[1,2],[3,4],[5,6]]", "scene.regions.c", [[1, 2], [3, 4], [5, 6]]),
        ("wind.path=winds/mine.csv", "wind.path", "winds/mine.csv"),
        ("wind.path=winds", "wind.path", "winds"),
        ("wind.path=winds/*.csv", "wind.path", "winds/*.csv"),
        ("wind.forecast_error=none", "wind.forecast_error", "none"),
        ("scene.name=it's \\ a \"name\" \\' Лес {x: [1]}", "scene.name",
         "it's \\ a \"name\" \\' Лес {x: [1]}"),
    ],
)  # fmt: skip
def test_settings_of_a_mission_are_accepted(place: Path, word: str, key: str, value: Any) -> None:
    """Hydra reads the same value from the word of the command line, and as a value by its key."""
    found: list[Any] = []
    folder = DeskFolder(place / "desk")
    for request in ({"overrides": [word]}, {"settings": {key: value}}):
        (written,) = command_words(folder, request)[1:]
        (override,) = OverridesParser.create().parse_overrides([written])
        found.append(override.value())
    assert found == [value, value]
    assert [type(one) for one in found] == [type(value)] * 2


@pytest.mark.parametrize(
    "text",
    [
        "",
        "'",
        "\\",
        "\\'",
        "a\\\\'b\\",
        "\\\\\\",
        "'' \"",
        "a\nb",
        "{[(,=)]}",
        "str(x)",
        "é☃𝄞",
        "null",
        "1e3",
    ],
)
def test_a_text_in_quotes_is_read_back(text: str) -> None:
    (override,) = OverridesParser.create().parse_overrides([f"scene.name={quoted(text)}"])
    assert override.value() == text


def test_the_last_of_a_key_counts_and_choices_come_first(place: Path) -> None:
    request = {
        "settings": {"planner.trees": 1, "robot": "multirotor", "experiment": "hop"},
        "overrides": ["planner.trees=2", "wind=calm"], "formula": "F a",
    }  # fmt: skip
    words = command_words(DeskFolder(place / "desk"), request)
    assert words == [
        "plan", "+experiment=hop", "robot=multirotor", "wind=calm", "planner.trees=2",
        "mission.formula='F a'",
    ]  # fmt: skip


# --- after composition ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("word", "said"),
    [
        ("wind.path=str(/etc/passwd)", "wind.path"), ("scene.file=../outside/canary.geojson", "outside"),
        ("evaluation.cluster=127.0.0.1:9", "evaluation.cluster"), ("wind.base_url=http://127.0.0.1:9",
        "base_url"),
        ("evaluation.resume=link", "evaluation.resume"), ("wind.forecast_error=link/canary.csv", "outside"),
        ("seed=1,2", "several values"), ("+selection.options.path=/etc/passwd", "selection.options"),
    ],
)  # fmt: skip
def test_composed_settings_are_checked_once_more(
    place: Path, word: str, said: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A word that gets past the first check is refused by the worker, before a directory is made."""
    monkeypatch.chdir(place / "desk")
    with watched() as seen:
        assert run_at_desk(["plan", "+experiment=hop", word, "hydra.run.dir=plans/never"]) == 2
    error = capsys.readouterr().err
    assert said in error
    assert CANARY not in error
    assert len(error.splitlines()) == 1
    assert not (place / "desk" / "plans" / "never").exists()
    assert [entry for entry in seen if "canary" in entry[1] or "socket" in entry[0]] == []


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("name", EXAMPLES)
def test_shipped_choices_pass_the_check(place: Path, command: str, name: str) -> None:
    class PassedError(ConfigError):
        pass

    def accept(settings: Settings) -> None:
        check_composed(DeskFolder(place / "desk"), settings)
        raise PassedError

    with pytest.MonkeyPatch.context() as patch:
        passed: list[BaseException] = []
        patch.setattr(
            "pareto_ltl_apps.cli.hydra_app.explain_error", lambda error: passed.append(error) or "passed"
        )
        assert run_accepted([f"+experiment={name}"], command, accept) == 2
    assert [type(error) for error in passed] == [PassedError]
