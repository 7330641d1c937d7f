"""A missing package of an extra: one line with the command that installs it."""

from __future__ import annotations

import subprocess
import sys
import tomllib
from importlib.util import find_spec
from pathlib import Path

import pytest

from pareto_ltl.support.errors import ConfigError
from pareto_ltl.support.extras import EXTRAS
from pareto_ltl_apps.cli.commands import run_command_line
from pareto_ltl_apps.flight import link
from pareto_ltl_apps.formats.netcdf_files import netcdf_snapshots
from pareto_ltl_apps.formats.quantities import WINDS
from pareto_ltl_apps.studies import cluster

ROOT = Path(__file__).resolve().parents[2]
STATED = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]


def open_cluster() -> None:
    with cluster.connected("tcp://127.0.0.1:1"):
        pass


def test_extras_and_their_modules_exist() -> None:
    assert set(EXTRAS.modules) < set(STATED)
    for extra, modules in EXTRAS.modules.items():
        assert all(find_spec(module) is not None for module in modules), extra


@pytest.mark.parametrize(("extra", "module"), [(e, m) for e, ms in EXTRAS.modules.items() for m in ms])
def test_each_missing_package_is_named_with_the_command(
    extra: str, module: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    EXTRAS.require(extra, "this")
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(ConfigError) as caught:
        EXTRAS.require(extra, "this")
    assert str(caught.value).startswith(f"this needs {module}: ")
    assert f'pip install "pareto-ltl[{extra}]"' in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("module", "extra", "use"),
    [
        ("xarray", "netcdf", lambda: netcdf_snapshots((Path("wind.nc"),), WINDS, "10m", 75.0)),
        ("cf_xarray", "netcdf", lambda: netcdf_snapshots((Path("wind.nc"),), WINDS, "10m", 75.0)),
        ("distributed", "dask", open_cluster),
        ("pymavlink", "follow", link._mavutil),  # noqa: SLF001
    ],
)
def test_what_reads_with_a_missing_package_says_how_to_install_it(
    module: str, extra: str, use: object, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(ConfigError, match=rf'pip install "pareto-ltl\[{extra}\]"'):
        use()  # type: ignore[operator]


@pytest.mark.parametrize(
    ("words", "module", "extra"),
    [
        (["serve"], "uvicorn", "serve"),
        (["serve"], "pmtiles", "serve"),
        (["scores", "."], "scores", "scores"),
        (["+experiment=phi1", "wind=netcdf", f"wind.path={ROOT / 'tests'}"], "xarray", "netcdf"),
    ],
)
def test_a_command_ends_with_one_line(
    words: list[str], module: str, extra: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, module, None)
    assert run_command_line(words) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1, lines
    assert f'pip install "pareto-ltl[{extra}]"' in lines[0]


def test_a_plan_in_python_loads_neither_hydra_nor_the_readers_of_other_files() -> None:
    code = (
        "import sys, pareto_ltl\n"
        "from small_plans import COMMON, MISSIONS\n"
        "scene, formula, sections = MISSIONS['paper']\n"
        "result = pareto_ltl.plan(scene, formula, **COMMON | sections)\n"
        "print(result.plan is not None)\n"
        "unwanted = ('hydra', 'omegaconf', 'xarray', 'cf_xarray', 'starlette', 'IPython')\n"
        "print([name for name in unwanted if name in sys.modules])\n"
    )
    folder = ROOT / "tests"  # of small_plans
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.stdout.splitlines() == ["True", "[]"], done.stderr
