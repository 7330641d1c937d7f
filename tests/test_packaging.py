"""What travels with the code, and what the code was pinned to."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tomllib
from dataclasses import asdict
from importlib.metadata import entry_points
from pathlib import Path

import pytest
import yaml

import pareto_ltl
from careful_io.fingerprints import file_hashes
from pareto_ltl.run import provenance
from pareto_ltl.settings import Settings
from pareto_ltl.support import resources, schemas
from pareto_ltl_apps.view.components import MODULES, STYLE
from pareto_ltl_apps.view.page.content import SCRIPTS

ROOT = Path(__file__).resolve().parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
RUN_LOCK, LOCK = ((ROOT / f"requirements{part}.lock").read_text() for part in ("", "-dev"))


def test_a_checkout_finds_its_own_folders() -> None:
    assert resources.checkout() == ROOT
    assert resources.resource_folder("conf") == ROOT / "conf"
    assert resources.resource_folder("pipelines") == ROOT / "pipelines"


def test_a_wheel_finds_the_folders_inside_the_package(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    site = tmp_path / "lib" / "site-packages"
    package = site / "pareto_ltl"
    (package / "conf" / "wind").mkdir(parents=True)
    (package / "conf" / "wind" / "calm.yaml").touch()
    (tmp_path / "lib" / "conf").mkdir()  # somebody else's
    (tmp_path / "lib" / "pyproject.toml").touch()
    monkeypatch.setattr(resources, "PACKAGE", package)
    assert resources.checkout() is None
    assert resources.resource_folder("conf") == package / "conf"
    assert resources.CONF.names("wind") == ["calm"]


def test_the_wheel_carries_configuration_and_pipelines() -> None:
    forced = PROJECT["tool"]["hatch"]["build"]["targets"]["wheel"]["force-include"]
    assert forced == {"conf": "pareto_ltl/conf", "pipelines": "pareto_ltl/pipelines"}


def test_the_schemas_lie_in_the_package_which_the_wheel_carries_whole() -> None:
    packages = PROJECT["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"]
    for name in schemas.SCHEMA_NAMES:
        path = schemas.FOLDER / f"{name}.schema.json"
        assert path.is_file()
        assert any(path.is_relative_to(ROOT / package) for package in packages)
        assert (
            subprocess.run(["git", "-C", str(ROOT), "check-ignore", "-q", str(path)], check=False).returncode
            != 0
        )


def test_the_parts_of_the_page_lie_in_the_package_and_are_no_ignored_files() -> None:
    report = ROOT / "src" / "pareto_ltl_apps" / "view"
    own = (report / "page" / name for name in ("page.html", "page.css", *SCRIPTS))
    for file in (*own, *(report / "components" / name for name in (STYLE, *MODULES))):
        assert file.is_file()
        assert subprocess.run(
            ["git", "-C", str(ROOT), "check-ignore", "-q", str(file)], check=False
        ).returncode


def test_help_and_a_wrong_setting_do_not_load_fastjsonschema(tmp_path: Path) -> None:
    for words in (["--help"], ["+experiment=phi1", "seed=-x"], ["rerun", "nowhere"]):
        check = (
            "import sys; from pareto_ltl_apps.cli.console import main\n"
            f"sys.argv[1:] = {words}\ntry: main()\nexcept SystemExit: pass\n"
            "assert 'fastjsonschema' not in sys.modules"
        )
        done = subprocess.run(
            [sys.executable, "-c", check], cwd=tmp_path, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr


def test_the_source_archive_holds_all_that_git_does() -> None:
    """It takes what no .gitignore excludes, so no file of the repository may be excluded by one."""
    assert "sdist" not in PROJECT["tool"]["hatch"]["build"]["targets"]
    command = ["git", "-C", str(ROOT), "ls-files", "--cached", "--ignored", "--exclude-standard"]
    excluded = subprocess.run(command, capture_output=True, text=True, check=False).stdout.split()
    assert excluded == []


@pytest.mark.parametrize("name", ["ci", "night", "release"])
def test_the_actions_of_a_workflow_are_pinned_by_hash(name: str) -> None:
    text = (ROOT / ".github" / "workflows" / f"{name}.yml").read_text()
    used = re.findall(r"uses: (\S+)", text)
    assert used
    assert all(re.fullmatch(r"[\w-]+/[\w-]+@[0-9a-f]{40}", action) for action in used), used


def test_a_release_has_a_list_of_its_parts_and_a_statement_of_its_provenance() -> None:
    """After the wheels are built, over all that is uploaded."""
    text = (ROOT / ".github" / "workflows" / "release.yml").read_text()
    parts = ("make dist", "sbom.cdx.json", "attest-build-provenance@", "upload-artifact@")
    places = [text.find(part) for part in parts]
    assert -1 not in places, dict(zip(parts, places, strict=True))
    assert places == sorted(places)
    assert re.search(r"subject-path: dist/\*", text)


def test_the_console_script_leads_to_the_program() -> None:
    (script,) = (e for e in entry_points(group="console_scripts") if e.name == "pareto-ltl")
    assert script.value == "pareto_ltl_apps.cli.console:main"
    assert callable(script.load())


def test_the_wheel_reads_the_version_where_the_program_does() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "pareto_ltl", "--version"], capture_output=True, text=True, check=True
    )
    assert done.stdout == f"pareto-ltl {pareto_ltl.__version__}\n"
    assert PROJECT["project"]["dynamic"] == ["version"]
    source = (ROOT / PROJECT["tool"]["hatch"]["version"]["path"]).read_text()
    assert re.findall(r'^__version__ = "(.*)"$', source, re.M) == [pareto_ltl.__version__]


def test_the_citation_names_this_project() -> None:
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert citation["cff-version"] == "1.2.0"
    assert citation["version"] == pareto_ltl.__version__
    assert citation["license"] == PROJECT["project"]["license"]
    assert {"message", "title", "authors"} <= set(citation)


def test_the_changelog_has_a_section_for_what_comes_and_none_beyond_this_version() -> None:
    titles = re.findall(r"^## \[(.+?)\]", (ROOT / "CHANGELOG.md").read_text(), re.M)
    assert titles[0] == "Unreleased"
    assert titles[1:2] in ([], [pareto_ltl.__version__])


def test_the_conda_recipe_asks_for_what_the_wheel_does() -> None:
    recipe = yaml.safe_load((ROOT / "conda" / "recipe" / "recipe.yaml").read_text())
    named_otherwise = {"matplotlib": "matplotlib-base"}  # without Qt
    wanted = {f"python {PROJECT['project']['requires-python']}"}
    for requirement in PROJECT["project"]["dependencies"]:
        name = re.split("[<>=]", requirement)[0]
        wanted.add(f"{named_otherwise.get(name, name)} {requirement.removeprefix(name)}")
    assert set(recipe["requirements"]["run"]) == wanted
    (backend,) = PROJECT["build-system"]["requires"]
    assert backend.replace(">=", " >=") in recipe["requirements"]["host"]
    assert recipe["context"]["version"] == pareto_ltl.__version__
    scripts = [f"{name} = {target}" for name, target in PROJECT["project"]["scripts"].items()]
    assert recipe["build"]["python"]["entry_points"] == scripts
    assert recipe["about"]["summary"] == PROJECT["project"]["description"]


def test_the_locks_pin_every_dependency_by_hash() -> None:
    extras = [line for group in PROJECT["project"]["optional-dependencies"].values() for line in group]
    for lock, wanted in ((RUN_LOCK, []), (LOCK, extras)):
        pins = set(re.findall(r"^([a-z0-9._-]+)==", lock, re.M))
        for requirement in (*PROJECT["project"]["dependencies"], *wanted):
            name = re.match(r"[A-Za-z0-9._-]+", requirement)
            assert name is not None
            assert re.sub(r"[._-]+", "-", name[0]).lower() in pins, requirement
        blocks = re.split(r"^(?=\S)", lock, flags=re.M)[1:]
        assert len(blocks) == len(re.findall(r"^[a-z0-9._-]+==", lock, re.M))
        assert all("--hash=sha256:" in block for block in blocks)


def test_the_locks_hold_no_address_and_no_path() -> None:
    for lock in (RUN_LOCK, LOCK):
        assert not re.search(r"://|--index|--find-links|file:|\s/|\.\./", lock)


# --- provenance ------------------------------------------------------------------------------


def test_settings_come_back_from_their_yaml(tmp_path: Path) -> None:
    settings = Settings(seed=3)
    settings.scene.regions = {"a": [[0.0, 0.0], [1.5, 0.0], [0.0, 1e-7]]}
    settings.mission.formula = "F(a & F b) | !c U a"
    provenance.write_settings(tmp_path, settings)
    assert yaml.safe_load((tmp_path / "config_resolved.yaml").read_text()) == asdict(settings)


def test_any_setting_changes_the_fingerprint() -> None:
    one, two, three = Settings(), Settings(seed=1), Settings()
    three.planner.epsilon = 0.04
    prints = [provenance.config_hash(s) for s in (one, two, three)]
    assert len(set(prints)) == 3
    assert provenance.config_hash(Settings()) == prints[0]


def test_files_are_known_by_their_content(tmp_path: Path) -> None:
    path = tmp_path / "wind.csv"
    path.write_bytes(b"abc")  # the example of FIPS 180-2
    digest = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"
    assert file_hashes([path]) == {str(path): digest}


def test_a_commit_is_told_with_whether_files_changed(tmp_path: Path) -> None:
    assert provenance.git_state(None) is None
    assert provenance.git_state(tmp_path) is None
    git = ["git", "-C", str(tmp_path), "-c", "user.name=n", "-c", "user.email=e@example.org"]
    subprocess.run([*git, "init", "-q"], check=True)
    assert provenance.git_state(tmp_path) is None  # no commit yet
    subprocess.run([*git, "commit", "-q", "--allow-empty", "-m", "first"], check=True)
    state = provenance.git_state(tmp_path)
    assert state is not None
    assert re.fullmatch("[0-9a-f]{40}", state["commit"])
    assert state["changed"] is False
    (tmp_path / "new").touch()
    changed = provenance.git_state(tmp_path)
    assert changed is not None
    assert changed["changed"] is True


def test_looking_at_a_checkout_changes_nothing_in_it(tmp_path: Path) -> None:
    """Git would write times of files into its index, under a lock that a killed process leaves behind."""
    git = ["git", "-C", str(tmp_path), "-c", "user.name=n", "-c", "user.email=e@example.org"]
    (tmp_path / "file").write_text("same")
    for words in (["init", "-q"], ["add", "file"], ["commit", "-q", "-m", "first"]):
        subprocess.run([*git, *words], check=True)
    os.utime(tmp_path / "file", (1e9, 1e9))
    index = (tmp_path / ".git" / "index").read_bytes()
    assert provenance.git_state(tmp_path)["changed"] is False  # type: ignore[index]
    assert (tmp_path / ".git" / "index").read_bytes() == index
