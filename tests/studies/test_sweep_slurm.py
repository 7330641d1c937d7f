"""A sweep on a real SLURM: one node, started for the test where its programs are installed."""

from __future__ import annotations

import csv
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

HERE = Path(__file__).parents[1]
PROGRAMS = ("slurmctld", "slurmd", "slurmdbd", "munged", "mariadbd")
MISSING = [name for name in PROGRAMS if shutil.which(name, path=f"{os.environ['PATH']}:/usr/sbin") is None]

pytestmark = [
    pytest.mark.skipif(bool(MISSING), reason=f"SLURM is not installed here ({', '.join(MISSING)})"),
    pytest.mark.skipif(os.geteuid() != 0, reason="a SLURM of one's own is started as root"),
]


@pytest.fixture(scope="module")
def slurm() -> Iterator[dict[str, str]]:
    """The environment in which ``sbatch`` finds a SLURM of one node."""
    # Not in pytest's own folder: the database has a user of its own, who may not pass through that.
    with tempfile.TemporaryDirectory(prefix="pareto_ltl_slurm_", ignore_cleanup_errors=True) as folder:
        Path(folder).chmod(0o755)
        yield from _started(folder)


def _started(folder: str) -> Iterator[dict[str, str]]:
    environment = os.environ | {"PATH": f"{os.environ['PATH']}:/usr/sbin"}
    script = [str(HERE / "slurm" / "one_node.sh")]
    subprocess.run([*script, "start", folder], env=environment, check=True, timeout=180)
    try:
        yield environment | {"SLURM_CONF": f"{folder}/slurm.conf"}
    finally:
        subprocess.run([*script, "stop", folder], env=environment, check=True, timeout=60)


def sweep(environment: dict[str, str], *argv: str) -> subprocess.CompletedProcess[str]:
    words = [sys.executable, "-m", "pareto_ltl", "-m", "pipelines.stages=[trouble]", *argv]
    return subprocess.run(words, env=environment, capture_output=True, text=True, timeout=300, check=False)


CLUSTER = ("hydra/launcher=submitit_slurm", "hydra.launcher.cpus_per_task=1", "hydra.launcher.mem_gb=1")


def test_a_sweep_on_slurm_gives_the_same_summary_and_outlives_a_killed_job(
    slurm: dict[str, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    asked = tmp_path / "asked"
    asked.mkdir()
    environment = slurm | {"TROUBLE": str(asked), "PYTHONPATH": str(HERE / "faults")}
    points = "seed=0,1,2,3"
    assert sweep(environment, points, "hydra.sweep.dir=local").returncode == 0
    (asked / "kill_2").touch()
    done = sweep(environment, points, "hydra.sweep.dir=cluster", *CLUSTER)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "were killed; continuing with the others" in done.stderr
    assert Path("cluster/summary.csv").read_bytes() == Path("local/summary.csv").read_bytes()

    records = [json.loads(path.read_text()) for path in Path("cluster").glob("*/run.json")]
    assert {record["status"] for record in records} == {"ok"}
    assert {record["threads"] for record in records} == {1}  # what SLURM allotted, not what the node has
    with Path("cluster/summary.csv").open(newline="") as file:
        assert [row["seed"] for row in csv.DictReader(file)] == ["0", "1", "2", "3"]
    accounted = subprocess.run(
        ["sacct", "-X", "-n", "-o", "State%20"], env=environment, capture_output=True, text=True, check=True
    ).stdout.split()
    assert accounted.count("COMPLETED") >= 3  # the one that was run again may not be in the books yet
    assert accounted.count("FAILED") == 1
