"""What other packages add: found by entry points, used by the command line and from Python alike."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator, Sequence
from importlib import metadata
from importlib.metadata import EntryPoint, EntryPoints
from pathlib import Path
from types import ModuleType

import pytest

from declared_settings import extensions
from pareto_ltl.extend import Pipeline
from pareto_ltl.logic.patterns import formula_of
from pareto_ltl.run.pipeline import stages_by_name
from pareto_ltl.settings import MissionConfig, PipelineConfig, SelectionConfig, Settings, WindConfig
from pareto_ltl.settings.planner import SELECTION_RULES as RULE_NAMES
from pareto_ltl.settings.wind import wind_sources
from pareto_ltl.support.errors import ConfigError
from pareto_ltl.support.resources import CONF
from unmeasured import untraced

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "examples" / "extension"
SOURCE_NAMES = wind_sources()
SMALL = {"planner": {"trees": 2, "n_max": 500}, "fidelity": {"refine": "none"}}
ARGUMENTS = (
    "pipelines=briefed", "scene=harbour", "robot=glider", "wind=steady", "mission.pattern=all_but_one",
    "mission.goals=[a,b,c]", "selection.rule=shortest", "planner.trees=2", "planner.n_max=500",
    "fidelity.refine=none", "exports.formats=[legs,gpx]",
)  # fmt: skip


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """An environment with the example package as an installer leaves it: the code and its metadata."""
    site = tmp_path_factory.mktemp("site")
    shutil.copytree(EXAMPLE / "harbour_extension", site / "harbour_extension")
    project = tomllib.loads((EXAMPLE / "pyproject.toml").read_text())["project"]
    info = site / f"{project['name'].replace('-', '_')}-{project['version']}.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(
        f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}\n"
    )
    lines = [
        f"[{group}]\n" + "".join(f"{name} = {value}\n" for name, value in entries.items())
        for group, entries in project["entry-points"].items()
    ]
    (info / "entry_points.txt").write_text("\n".join(lines))
    paths = [str(site), os.environ.get("PYTHONPATH", "")]
    return untraced(PYTHONPATH=os.pathsep.join(filter(None, paths)))


def test_the_example_package_plans_from_the_command_line_and_from_python(
    installed: dict[str, str], tmp_path: Path
) -> None:
    command = [sys.executable, "-m", "pareto_ltl", *ARGUMENTS, "hydra.run.dir=one"]
    done = subprocess.run(command, cwd=tmp_path, env=installed, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    script = (
        "import pareto_ltl\n"
        "mission = {'pattern': 'all_but_one', 'goals': ['a', 'b', 'c']}\n"
        "result = pareto_ltl.plan('harbour', mission, robot='glider', wind='steady', pipelines='briefed',\n"
        f"    selection={{'rule': 'shortest'}}, out='two', exports={{'formats': ['legs', 'gpx']}},\n"
        f"    **{SMALL!r})\n"
        "lengths = [path.objectives.length for path in result.front.paths]\n"
        "assert result.plan.path.objectives.length == min(lengths)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script],
        cwd=tmp_path,
        env=installed,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    for name in ("plan.json", "front.csv", "briefing.txt", "legs.txt"):
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes()
    briefing = (tmp_path / "one" / "briefing.txt").read_text()
    assert briefing.startswith("F a & F b | F a & F c | F b & F c\nregions: a, b, c\n")


def test_a_section_of_another_package_has_checks_help_and_files(
    installed: dict[str, str], tmp_path: Path
) -> None:
    def call(*words: str) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, *words]
        return subprocess.run(
            command, cwd=tmp_path, env=installed, capture_output=True, text=True, check=False
        )

    words = ("-m", "pareto_ltl", *ARGUMENTS, "hydra.run.dir=one")
    done = call(*words, "briefing.minutes=soon")
    assert (done.returncode, done.stderr) == (
        2,
        "pareto-ltl: briefing.minutes must be true or false, got 'soon'\n",
    )
    done = call(*words, "briefing.minute=true")
    assert done.stderr == "pareto-ltl: unknown setting briefing.minute; did you mean briefing.minutes?\n"
    assert "briefing.minutes=false" in call("-m", "pareto_ltl", "--help=all").stdout
    done = call(*words, "briefing.minutes=true")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "one" / "briefing.txt").read_text().endswith(" min\n")
    script = (
        "{}\n{}\n"
        "settings = Settings.of_file(Path('one/config_resolved.yaml'))\n"
        "assert settings[BriefingConfig].minutes and settings.briefing.minutes\n"
        "settings = settings.with_sections(BriefingConfig(minutes=False))\n"
        "assert not settings[BriefingConfig].minutes\n"
    )
    imports = (
        "from pathlib import Path; from harbour_extension import BriefingConfig",
        "from pareto_ltl import Settings",
    )
    for order in (imports, imports[::-1]):  # each may be imported first
        done = call("-c", script.format(*order))
        assert done.returncode == 0, done.stderr


def test_a_rule_of_another_package_reads_its_options(installed: dict[str, str], tmp_path: Path) -> None:
    """A run, ``choose`` and ``verify`` with a rule that has an option, and the option in plan.json."""

    def call(*words: str) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-m", "pareto_ltl", *words]
        return subprocess.run(
            command, cwd=tmp_path, env=installed, capture_output=True, text=True, check=False
        )

    arguments = [word for word in ARGUMENTS if not word.startswith("selection.rule")]
    done = call(*arguments, "hydra.run.dir=one")
    assert done.returncode == 0, done.stderr
    done = call("choose", "one", "--rule", "within_hours")
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert "selection.options.hours must be a positive number [h], got None" in done.stderr
    done = call("choose", "one", "--rule", "within_hours", "selection.options.hours=0.1")
    assert "the quickest takes " in done.stderr
    done = call("choose", "one", "--rule", "within_hours", "selection.options.hours=90")
    assert done.returncode == 0, done.stderr
    plan = json.loads((tmp_path / "one_rule_within_hours" / "plan.json").read_text())
    assert plan["selection"]["rule"] == "within_hours"
    assert plan["selection"]["options"] == {"hours": 90}
    done = call("verify", "one_rule_within_hours", "--failed")
    assert done.returncode == 0, done.stdout
    assert "not checked, because another package adds selection.rule=within_hours: front: the rule" in (
        done.stdout
    )


@pytest.mark.parametrize(
    ("argument", "names"),
    [
        ("wind.source=storm", "calm, steady; got 'storm'"),
        ("selection.rule=best", "point, shortest, within_hours; got 'best'"),
        ("mission.pattern=zigzag", "key_door, all_but_one; got 'zigzag'"),
        ("robot=submarine", "there is no robot 'submarine'; there are airframe, fixed_wing, glider"),
        ("pipelines.stages=[briefings]", "briefing"),
    ],
)
def test_messages_list_what_other_packages_add(
    argument: str, names: str, installed: dict[str, str], tmp_path: Path
) -> None:
    kept = [word for word in ARGUMENTS if word.split("=")[0] != argument.split("=", maxsplit=1)[0]]
    command = [sys.executable, "-m", "pareto_ltl", *kept, argument]
    done = subprocess.run(command, cwd=tmp_path, env=installed, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert names in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_a_cost_of_the_example_package_is_computed_for_every_path_and_chosen_by(
    installed: dict[str, str], tmp_path: Path
) -> None:
    script = (
        "import csv, pareto_ltl\n"
        "import numpy as np\n"
        "mission = {'pattern': 'all_but_one', 'goals': ['a', 'b', 'c']}\n"
        "rule = {'costs': ['from_home'], 'rule': 'least', 'least': 'from_home', 'alpha': 0.99}\n"
        "result = pareto_ltl.plan('harbour', mission, robot='glider', wind='steady', selection=rule,\n"
        f"    out='one', **{SMALL!r})\n"
        "far = [np.hypot(*(path.x - path.x[0]).T).max() for path in result.front.paths]\n"
        "column = [float(row['from_home_m']) for row in csv.DictReader(open('one/front.csv'))]\n"
        "np.testing.assert_allclose(column, far, rtol=1e-9)\n"
        "assert result.plan.path.objectives.costs['from_home'] == min(column)\n"
    )
    command = [sys.executable, "-c", script]
    done = subprocess.run(command, cwd=tmp_path, env=installed, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_the_example_package_does_not_slow_the_start(installed: dict[str, str], tmp_path: Path) -> None:
    code = (
        "import sys\n"
        "from pareto_ltl_apps.cli import hydra_app as app\n"
        f"assert app.run_hydra([*{ARGUMENTS!r}, 'planner.trees=0']) == 2\n"
        "print([name for name in 'numpy scipy numba cvxpy shapely'.split() if name in sys.modules])\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], env=installed, capture_output=True, text=True, check=False
    )
    assert done.stdout == "[]\n", done.stderr


def test_the_module_of_a_section_may_import_every_name_of_the_planner_but_settings() -> None:
    code = (
        "import sys\n"
        "sys.modules['pareto_ltl.settings.all_sections'] = None\n"
        "import pareto_ltl, pareto_ltl.extend\n"
        "from careful_io.stated_names import stated_names\n"
        "for module in (pareto_ltl, pareto_ltl.extend):\n"
        "    for name, place in stated_names(module.__file__).items():\n"
        "        if name != 'Settings' and place.startswith('pareto_ltl.'): getattr(module, name)\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


# --- entry points that are wrong -----------------------------------------------------------------


@pytest.fixture
def added(monkeypatch: pytest.MonkeyPatch) -> Iterator[dict[str, dict[str, str]]]:
    """Entry points by group and name, beside those of this project."""
    table: dict[str, dict[str, str]] = {}
    own = list(metadata.distribution("pareto-ltl").entry_points)

    plain = metadata.entry_points

    def entry_points(group: str = "") -> Sequence[EntryPoint] | EntryPoints:
        if not group:  # numba asks for all
            return plain()
        others = [EntryPoint(name, value, group) for name, value in table.get(group, {}).items()]
        return [*(entry for entry in own if entry.group == group), *others]

    monkeypatch.setattr("importlib.metadata.entry_points", entry_points)
    extensions.installed_entries.cache_clear()
    yield table
    extensions.installed_entries.cache_clear()


def test_a_name_that_is_taken_is_refused(added: dict[str, dict[str, str]]) -> None:
    added["pareto_ltl.stages"] = {"forest": "os:path"}
    added["pareto_ltl.wind_sources"] = {"csv": "os:path"}
    added["pareto_ltl.patterns"] = {"patrol": "os:path"}
    added["pareto_ltl.selection_rules"] = {"priority": "os:path"}
    from pareto_ltl.planning.records import Front
    from pareto_ltl.planning.selection_rules import choose_path
    from pareto_ltl.wind.sources import wind_source

    taken = "has a name that pareto_ltl uses; rename it, or uninstall it"
    with pytest.raises(ConfigError, match=f"entry point 'forest' .* {taken}"):
        stages_by_name(Settings())
    with pytest.raises(ConfigError, match=f"entry point 'csv' .* {taken}"):
        wind_source(WindConfig())
    with pytest.raises(ConfigError, match=f"entry point 'patrol' .* {taken}"):
        formula_of(MissionConfig(pattern="sequence", goals=["a"]))
    with pytest.raises(ConfigError, match=f"entry point 'priority' .* {taken}"):
        choose_path(SelectionConfig(), Front((), (), 0.0, None))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("value", "reason"),
    [
        ("no_such_module:STAGE", "cannot be loaded (ModuleNotFoundError: No module named 'no_such_module')"),
        ("os:no_such_name", "cannot be loaded (AttributeError"),
        ("os:getcwd", "is a builtin_function_or_method, which this group does not take"),
        ("pareto_ltl.run.plan_run:PLAN_STAGES", "is a tuple, which this group does not take"),
    ],
)
def test_an_entry_point_that_does_not_work_is_one_line(
    value: str, reason: str, added: dict[str, dict[str, str]]
) -> None:
    added["pareto_ltl.stages"] = {"mine": value}
    with pytest.raises(ConfigError, match="sitl, mine, and"):  # known, and not loaded
        Pipeline.of(listing("other"))
    with pytest.raises(ConfigError) as caught:
        stages_by_name(listing("mine"))
    assert reason in str(caught.value)
    assert "\n" not in str(caught.value)


def listing(name: str) -> Settings:
    """Settings of a pipeline of one stage."""
    return Settings(pipelines=PipelineConfig(stages=[name]))


@pytest.mark.parametrize(
    ("code", "reason"),
    [
        ("SECTIONS = [1]", "is a list, which this group does not take"),
        ("SECTIONS = (1,)", "is a tuple, which this group does not take"),
        ("raise OSError('gone')", "cannot be loaded (OSError: gone)"),
        (
            "class A(CheckedSettings, section='scene'): pass\nSECTIONS = (A,)",
            "'scene' of mine: the name is taken",
        ),
        ("class A(CheckedSettings, section='of'): pass\nSECTIONS = (A,)", "'of' of mine: the name is taken"),
    ],
)
def test_settings_of_another_package_that_do_not_work_are_one_line(
    code: str, reason: str, tmp_path: Path
) -> None:
    (tmp_path / "mine.py").write_text(f"from pareto_ltl.extend import CheckedSettings\n{code}\n")
    info = tmp_path / "mine-1.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: mine\nVersion: 1\n")
    (info / "entry_points.txt").write_text("[pareto_ltl.settings]\nmine = mine:SECTIONS\n")
    paths = os.pathsep.join(filter(None, [str(tmp_path), os.environ.get("PYTHONPATH", "")]))
    for word in ("--help", "+experiment=phi1"):
        done = subprocess.run(
            [sys.executable, "-m", "pareto_ltl", word],
            cwd=tmp_path, env=untraced(PYTHONPATH=paths), capture_output=True, text=True, check=False,
        )  # fmt: skip
        assert done.returncode == 2, done.stderr
        assert reason in done.stderr
        assert done.stderr.count("\n") == 1


def test_a_format_of_another_package_is_written_and_cannot_take_a_file(
    added: dict[str, dict[str, str]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is a choice of the settings, its file is written and cleared, and it cannot replace plan.json."""
    import pareto_ltl
    from pareto_ltl_apps.exports.kinds import format_files, format_named, format_names

    module = ModuleType("others_formats")
    module.LEGS = pareto_ltl.ExportFormat("legs.txt", lambda exported: b"%d" % len(exported.log.t))  # type: ignore[attr-defined]
    module.THIEF = pareto_ltl.ExportFormat("plan.json", lambda _: b"")  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "others_formats", module)
    added["pareto_ltl.exports"] = {"legs": "others_formats:LEGS", "lost": "no_such_module:LOST"}
    assert format_names()[-2:] == ("legs", "lost")
    assert "legs.txt" in format_files()
    run = pareto_ltl.plan("phi1", "F a", wind="calm", **SMALL, seed=1)
    (written,) = pareto_ltl.export(run, tmp_path, ["legs"])
    assert int(written.read_bytes()) == len(run.plan.path.t)
    assert (tmp_path / "legs.txt") == written
    with pytest.raises(ConfigError, match=r"'lost' .* cannot be loaded"):
        pareto_ltl.export(run, tmp_path, ["lost"])
    with pytest.raises(ConfigError, match=r"exports\.formats must be .*f3548, legs, lost; got 'other'"):
        pareto_ltl.export(run, tmp_path, ["other"])
    extensions.installed_entries.cache_clear()
    added["pareto_ltl.exports"] = {"thief": "others_formats:THIEF"}
    assert format_files().count("plan.json") == 0
    with pytest.raises(ConfigError, match=r"'thief' .* writes plan\.json, which is another file of a run"):
        format_named("thief")
    for name in ("", "a/b.txt", "..\\x", "*.txt"):
        with pytest.raises(ConfigError, match="the name of a file in no folder"):
            pareto_ltl.ExportFormat(name, lambda _: b"")


def test_a_choice_with_the_name_of_another_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "robot").mkdir()
    (tmp_path / "robot" / "airframe.yaml").touch()
    monkeypatch.setattr(extensions.Group, "folders", lambda group: (tmp_path,))
    with pytest.raises(ConfigError, match="there is another choice conf/robot/airframe; rename this one"):
        CONF.names("wind")


def test_the_names_in_the_settings_are_those_of_the_tables() -> None:
    from pareto_ltl.planning.selection_rules import RULES

    assert tuple(RULES) == RULE_NAMES
    assert Settings().wind.source in SOURCE_NAMES


def test_verify_knows_every_wind_source_and_its_usual_law() -> None:
    from pareto_ltl_apps.formats.live_models import MODELS
    from pareto_ltl_verify import sources

    assert sources.SOURCES.keys() == SOURCE_NAMES.keys()
    for name, known in sources.SOURCES.items():
        of_model = MODELS[name].law if name in MODELS else ""
        assert known.law in (None, of_model or SOURCE_NAMES[name].forecast_error)
        assert known.modelled == SOURCE_NAMES[name].modelled


@pytest.mark.parametrize("name", SOURCE_NAMES)
def test_a_source_that_reads_files_needs_a_path(name: str) -> None:
    if SOURCE_NAMES[name].reads_path:
        with pytest.raises(ConfigError, match=f"wind.path is missing: wind.source={name} needs a file"):
            WindConfig(source=name)
    else:
        assert WindConfig(source=name).path is None


def test_verify_knows_every_rule_of_this_package_and_the_settings_that_it_reads() -> None:
    from pareto_ltl.planning.selection_rules import RULES
    from pareto_ltl_verify.claims import choice, plan

    assert tuple(choice.RANKINGS) == RULE_NAMES
    assert {name: rule.reads for name, rule in RULES.items()} == plan.READS
