"""The wheel with machine code: a first run in an empty environment compiles nothing.

At night, since the kernels of a run compile for a minute or two. The variable ``PARETO_LTL_WHEEL`` can name
the wheel of pure Python; without it, the test builds that first.
"""

from __future__ import annotations

import base64
import csv
import hashlib
import json
import os
import platform
import subprocess
import sys
import zipfile
from pathlib import Path

import numba
import pytest

from typed_kernels.shipped_code import BASELINES
from unmeasured import untraced

ROOT = Path(__file__).resolve().parents[1]
INFO = "pareto_ltl-*.dist-info"
PACKAGES = ("pareto_ltl/kernels", "plane_kernels", "plane_logic")
# Also counts what numba compiles without a cache. Names of compiled functions are the last line.
RUN = """
import sys
from numba.core import event
from pareto_ltl_apps.cli.commands import run_command_line

with event.install_recorder("numba:compile") as recorded:
    code = run_command_line(sys.argv[1:])
print(*[news.data["dispatcher"].py_func.__name__ for _, news in recorded.buffer if news.is_start])
sys.exit(code)
"""


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel with the code of default runs."""
    if platform.machine() not in BASELINES:
        pytest.skip(f"there is no baseline for {platform.machine()}")
    folder = tmp_path_factory.mktemp("dist")
    pure = os.environ.get("PARETO_LTL_WHEEL")
    if pure is None:
        command = [sys.executable, "-m", "build", "--wheel", "--outdir", str(folder), str(ROOT)]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        (pure,) = map(str, folder.glob("*-py3-none-any.whl"))
    out = folder / "code"
    out.mkdir()
    command = [
        sys.executable,
        str(ROOT / "release" / "machine_code.py"),
        pure,
        "--kinds",
        "full",
        "--out",
        str(out),
    ]
    subprocess.run(command, check=True, env=untraced(), stdout=subprocess.DEVNULL)
    (made,) = out.glob("*.whl")
    return made


@pytest.fixture(scope="module")
def site(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel in a folder that cannot be written; its dependencies come from this environment."""
    folder = tmp_path_factory.mktemp("site")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder)
    for path in (*folder.rglob("*"), folder):
        path.chmod(0o555 if path.is_dir() else 0o444)
    return folder


def test_tags_metadata_and_manifest_name_python_and_numba(wheel: Path, site: Path) -> None:
    python = f"cp{sys.version_info.major}{sys.version_info.minor}"
    assert f"-{python}-{python}-" in wheel.name
    (info,) = site.glob(INFO)
    assert f"Tag: {python}-{python}-" in (info / "WHEEL").read_text()
    assert "Root-Is-Purelib: false" in (info / "WHEEL").read_text()
    needed = [line for line in (info / "METADATA").read_text().splitlines() if "Requires-Dist: numba" in line]
    assert needed == [f"Requires-Dist: numba=={numba.__version__}"]
    for package in PACKAGES:
        manifest = json.loads((site / package / "machine_code" / "manifest.json").read_text())
        assert manifest["numba"] == numba.__version__
        assert manifest["target"][1] == BASELINES[platform.machine()][0]
        assert manifest["files"]


def test_the_record_lists_every_file_with_its_checksum(site: Path) -> None:
    (info,) = site.glob(INFO)
    rows = list(csv.reader((info / "RECORD").read_text().splitlines()))
    assert {row[0] for row in rows} == {
        path.relative_to(site).as_posix() for path in site.rglob("*") if path.is_file()
    }
    for name, digest, size in rows:
        if digest:
            data = (site / name).read_bytes()
            found = base64.urlsafe_b64encode(hashlib.sha256(data).digest()).rstrip(b"=").decode()
            assert (digest, int(size)) == (f"sha256={found}", len(data)), name


def test_no_path_of_the_package_that_was_compiled_is_in_the_code(site: Path) -> None:
    for package in PACKAGES:
        for file in (site / package / "machine_code").iterdir():
            assert b"/pareto_ltl/" not in file.read_bytes()
            assert b"/plane_kernels/" not in file.read_bytes()


def test_a_first_run_compiles_nothing_and_writes_no_code(site: Path, tmp_path: Path) -> None:
    home = tmp_path / "home"
    home.mkdir()
    surroundings = untraced(PYTHONPATH=str(site), HOME=str(home), XDG_CACHE_HOME=str(home / "cache"))
    surroundings = {k: v for k, v in surroundings.items() if not k.startswith(("NUMBA_", "PARETO_LTL_"))}
    before = {path for path in site.rglob("*") if path.suffix != ".pyc"}
    words = ["+experiment=phi2", "hydra.run.dir=run"]
    done = subprocess.run(
        [sys.executable, "-c", RUN, *words],
        cwd=tmp_path,
        env=surroundings,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == ""  # what was compiled
    assert "compiling" not in (tmp_path / "run" / "run.log").read_text()
    assert json.loads((tmp_path / "run" / "metrics.json").read_text())["completed"] == 1.0
    assert not [*home.rglob("*.nbc"), *home.rglob("*.nbi")]
    assert {path for path in site.rglob("*") if path.suffix != ".pyc"} - before <= set(
        site.rglob("__pycache__")
    )
