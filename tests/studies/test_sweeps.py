"""Sweeps: every job once, whatever is killed, and one table at the end."""

from __future__ import annotations

import csv
import hashlib
import json
import os
import signal
import statistics
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import binomtest

from careful_io import locks
from careful_io.files import write_json
from careful_io.fingerprints import file_hashes
from pareto_ltl.run import provenance
from pareto_ltl.settings import Settings
from pareto_ltl.settings.fidelity import LAWS
from pareto_ltl.support.errors import ConfigError, DataError
from pareto_ltl.support.resources import CONF
from pareto_ltl_apps.cli import composition
from pareto_ltl_apps.cli import hydra_app as app
from pareto_ltl_apps.cli.commands import run_command_line
from pareto_ltl_apps.studies import jobs, sweeps
from pareto_ltl_apps.studies import sweep_summary as summary
from pareto_ltl_apps.studies.jobs import JobQueue, JobState, RunJob
from pareto_ltl_apps.studies.sweeps import FigureChoice, SweepManifest, SweepPoint
from patience import PATIENCE, wait_until
from unmeasured import untraced

FAULTS = Path(__file__).parents[1] / "faults"
PLACE = Path("multirun/plan")
SMALL = (
    "+experiment=phi1", "name=plan", "wind=calm", "planner.trees=2", "planner.n_max=600",
    "fidelity=paper", "fidelity.refine=none",     "deployment.runs=20", "report=none",
)  # fmt: skip
PLANNED = (
    "pipelines.stages=[trouble,readings,scene,decomposition,automaton,observations,wind,problem,forest,front,"
    "plan,forecasts,deployment]"
)


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def asked(here: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder that tells stage ``trouble`` of other processes what to do."""
    folder = here / "asked"
    folder.mkdir()
    monkeypatch.setenv("TROUBLE", str(folder))
    monkeypatch.setenv("PYTHONPATH", str(FAULTS), prepend=os.pathsep)
    return folder


def start(*argv: str) -> subprocess.Popen[str]:
    words = [sys.executable, "-m", "pareto_ltl", "-m", *argv]
    return subprocess.Popen(
        words,
        env=untraced(),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


def sweep(*argv: str) -> subprocess.CompletedProcess[str]:
    with start(*argv) as process:
        out, err = process.communicate(timeout=PATIENCE)
    return subprocess.CompletedProcess(argv, process.returncode, out, err)


def csv_rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def statuses(place: Path = PLACE) -> dict[str, str]:
    return {row["seed"]: row["status"] for row in csv_rows(place / "summary.csv")}


def begun(asked: Path) -> list[str]:
    told = asked / "begun.txt"
    return sorted(told.read_text().split()) if told.exists() else []


TROUBLED = (
    "pipelines.stages=[trouble]",
    "seed=range(0,6)",
    "hydra/launcher=joblib",
    "hydra.launcher.n_jobs=2",
)


# --- whole sweeps, in processes of their own ---------------------------------------------------


def test_a_launcher_killed_in_the_middle_and_started_again_gives_the_same_summary(asked: Path) -> None:
    argv = (*SMALL, PLANNED, "seed=range(0,5)", "hydra/launcher=joblib", "hydra.launcher.n_jobs=2")
    for seed in (3, 4):
        (asked / f"hold_{seed}").touch()
    with start(*argv) as process:
        wait_until(lambda: len(list(PLACE.glob("*/metrics.json"))) == 3)
        process.kill()
    assert len(list(PLACE.glob("*/metrics.json"))) == 3
    with start(*argv) as again:  # what it finds, while the jobs of the killed launcher are still at work
        assert again.stdout is not None
        assert "3 of 5 have their answers already" in again.stdout.readline()
        for seed in (3, 4):
            (asked / f"hold_{seed}").unlink()
        _, err = again.communicate(timeout=PATIENCE)
    assert again.returncode == 0, err
    undisturbed = sweep(*argv, "hydra.sweep.dir=undisturbed")
    assert undisturbed.returncode == 0, undisturbed.stderr
    whole = Path("undisturbed/summary.csv").read_bytes()
    assert (PLACE / "summary.csv").read_bytes() == whole
    assert whole.count(b",ok,,1.0,") == 5
    for job in Path("undisturbed").glob("*/plan.json"):
        assert (PLACE / job.parent.name / "plan.json").read_bytes() == job.read_bytes()


def test_a_sweep_that_is_asked_to_end_ends_its_jobs_and_goes_on_later(asked: Path) -> None:
    for seed in range(6):
        (asked / f"hold_{seed}").touch()
    (asked / "slow_1").touch()  # the pool must not kill it because the other has ended
    with start(*TROUBLED) as process:
        wait_until(lambda: len(begun(asked)) == 2)
        process.terminate()
        _, err = process.communicate(timeout=PATIENCE)
    assert process.returncode == 143, err
    assert [line for line in err.splitlines() if "stopped" in line] == ["pareto-ltl: stopped by SIGTERM"]
    found = [json.loads(path.read_text())["status"] for path in PLACE.glob("*/run.json")]
    assert "stopped" in found
    assert set(found) <= {"ok", "stopped"}
    for seed in range(6):
        (asked / f"hold_{seed}").unlink()
    assert sweep(*TROUBLED).returncode == 0


def test_half_the_jobs_killed_once_are_run_again_by_the_same_command(asked: Path) -> None:
    for seed in (1, 3, 5):
        (asked / f"kill_{seed}").touch()
    done = sweep(*TROUBLED)
    assert done.returncode == 0, done.stderr
    assert set(statuses().values()) == {"ok"}
    assert "were killed; continuing with the others" in done.stderr
    assert "Traceback" not in done.stderr


def test_a_job_that_kills_its_process_every_time_is_given_up_and_the_others_are_done(asked: Path) -> None:
    (asked / "kill_always_2").touch()
    done = sweep(*TROUBLED)
    assert done.returncode == 2
    assert statuses() == {str(seed): "failed" if seed == 2 else "ok" for seed in range(6)}
    (row,) = (row for row in csv_rows(PLACE / "summary.csv") if row["seed"] == "2")
    assert "killed" in row["error"]
    assert begun(asked).count("2") <= 3

    (asked / "kill_always_2").unlink()  # more memory, say: the same command does what is missing
    (asked / "begun.txt").unlink()
    assert sweep(*TROUBLED).returncode == 0
    assert begun(asked) == ["2"]


def test_a_full_disk_an_infeasible_job_and_a_damaged_result_leave_the_others_alone(asked: Path) -> None:
    (asked / "full_1").touch()
    (asked / "none_4").touch()
    argv = [word for word in TROUBLED if "launcher" not in word]  # one after the other, in one process
    done = sweep(*argv)
    assert done.returncode == 2
    assert "No space left on device" in done.stderr
    expected = {str(seed): "ok" for seed in range(6)} | {"1": "failed", "4": "infeasible"}
    assert statuses() == expected

    (asked / "full_1").unlink()
    (asked / "begun.txt").unlink()
    broken = next(path for path in PLACE.glob("*/metrics.json"))
    seed = json.loads((broken.parent / "run.json").read_text())["seed"]
    broken.write_text('{"completed": 1')
    assert run_command_line(["sweep", str(PLACE)]) == 0
    assert statuses()[str(seed)] == "failed"
    assert sweep(*argv).returncode == 0  # that there is no plan is an answer
    assert begun(asked) == sorted(["1", str(seed)])
    assert statuses() == expected | {"1": "ok"}


def test_the_same_sweep_started_twice_at_once_is_done_once(asked: Path) -> None:
    (asked / "hold_5").touch()
    with start(*TROUBLED) as first:
        wait_until(lambda: bool(begun(asked)))
        second = sweep(*TROUBLED)
        (asked / "hold_5").unlink()
        _, err = first.communicate(timeout=PATIENCE)
    assert first.returncode == 0, err
    assert second.returncode == 2
    assert second.stderr.count("\n") == 1
    assert f"a sweep is at work in {PLACE} already (process {first.pid}" in second.stderr
    assert begun(asked) == [str(seed) for seed in range(6)]


def test_two_sweeps_into_one_folder_do_not_mix(asked: Path, capsys: pytest.CaptureFixture[str]) -> None:
    base = "pipelines.stages=[trouble]"
    assert sweep(base, "seed=0,1").returncode == 0
    older = (PLACE / "summary.csv").read_bytes()
    key = json.loads((PLACE / "sweep.json").read_text())["sweep"]
    assert sweep(base, "seed=1,2,3").returncode == 0
    assert sorted(statuses()) == ["1", "2", "3"]
    assert begun(asked) == ["0", "1", "2", "3"]  # what both have in common is done once
    assert run_command_line(["sweep", str(PLACE), "--sweep", key]) == 0
    assert (PLACE / "sweeps" / key / "summary.csv").read_bytes() == older
    assert run_command_line(["sweep", str(PLACE), "--sweep", "elsewhere"]) == 2
    assert key in capsys.readouterr().err


def test_submitit_runs_the_same_sweep(asked: Path) -> None:
    argv = ("pipelines.stages=[trouble]", "seed=0,1,2")
    assert sweep(*argv).returncode == 0
    done = sweep(*argv, "hydra/launcher=submitit_local", "hydra.sweep.dir=cluster")
    assert done.returncode == 0, done.stderr
    assert Path("cluster/summary.csv").read_bytes() == (PLACE / "summary.csv").read_bytes()
    records = [json.loads(path.read_text()) for path in Path("cluster").glob("*/run.json")]
    assert {record["threads"] for record in records} == {1}
    assert len({record["pid"] for record in records}) == 3


def test_submitit_waits_for_all_jobs_when_one_is_killed_and_runs_that_one_again(asked: Path) -> None:
    (asked / "kill_0").touch()
    (asked / "hold_1").touch()
    argv = ("pipelines.stages=[trouble]", "seed=0,1", "hydra/launcher=submitit_local")
    with start(*argv, "hydra.sweeper.max_batch_size=2") as process:
        wait_until(lambda: not (asked / "kill_0").exists())
        (asked / "hold_1").unlink()
        out, err = process.communicate(timeout=PATIENCE)
    assert process.returncode == 0, out + err
    assert set(statuses().values()) == {"ok"}
    assert begun(asked) == ["0", "0", "1"]  # nothing that was at work was started anew


def test_a_point_in_the_middle_that_cannot_be_stops_the_sweep_before_its_first_job(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert app.run_hydra(["-m", "+experiment=phi1", "planner.n_max=100,1,200"]) == 2
    assert "planner.n_max must lie in [2, 1e8], got 1" in capsys.readouterr().err
    assert list(here.iterdir()) == []


def test_a_figure_by_what_is_not_varied_stops_the_sweep_before_its_first_job(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert app.run_hydra(["-m", "+experiment=phi1", "seed=0,1", "sweep.by=planner.n_max"]) == 2
    assert "sweep.by=planner.n_max is not a setting that this sweep varies; there are seed" in (
        capsys.readouterr().err
    )
    assert list(here.iterdir()) == []


def test_a_ready_sweep_without_its_flag_is_refused(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert app.run_hydra(["+experiment=phi1", "+sweep=seeds"]) == 2
    assert "a sweep over seed=range(0,20): add -m to run it" in capsys.readouterr().err
    assert list(here.iterdir()) == []


@pytest.mark.parametrize("name", CONF.names("sweep"))
def test_every_ready_sweep_composes_with_a_mission(name: str) -> None:
    arguments = composition.parse_flags(["-m", "+experiment=phi2", f"+sweep={name}"])
    with composition.opened_hydra(arguments) as hydra:
        assert composition.prepare(hydra, arguments).pipeline is None


def test_a_launcher_that_is_not_installed_is_named_with_its_extra(
    here: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(composition, "find_spec", lambda name: None)
    assert app.run_hydra(["-m", "+experiment=phi1", "seed=0,1", "hydra/launcher=joblib"]) == 2
    assert 'pip install "pareto-ltl[sweep]"' in capsys.readouterr().err


# --- one job ---------------------------------------------------------------------------------


def answer(directory: Path, **changes: Any) -> Path:
    """A directory as a run leaves it."""
    directory.mkdir(parents=True, exist_ok=True)
    record = {
        "status": "ok",
        "error": None,
        "measured": True,
        "config_hash": directory.name + "0" * 48,
        "inputs": {},
        "overrides": [],
    }
    write_json(directory / "run.json", record | changes)
    write_json(directory / "metrics.json", {"completed": 1.0, "run_seconds": 2.0})
    return directory


def test_an_answer_counts_only_while_its_code_settings_and_inputs_are_the_same(tmp_path: Path) -> None:
    wind = tmp_path / "wind.csv"
    wind.write_text("one")
    inputs = file_hashes([wind])
    assert RunJob(answer(tmp_path / ("a" * 16), inputs=inputs)).settled()
    assert not RunJob(answer(tmp_path / ("b" * 16), config_hash="c" * 64)).settled()
    wind.write_text("another")
    assert not RunJob(tmp_path / ("a" * 16)).settled()
    wind.unlink()
    assert not RunJob(tmp_path / ("a" * 16)).settled()


@pytest.mark.parametrize("text", ["", "[]", "{", '{"completed": "yes"}', '{"length_m": 1.0}'])
def test_damaged_metrics_are_no_answer(text: str, tmp_path: Path) -> None:
    place = answer(tmp_path / "job")
    assert RunJob(place).settled()
    (place / "metrics.json").write_text(text)
    assert RunJob(place).look().status == "failed"
    assert not RunJob(place).settled()


def test_a_job_that_says_it_runs_is_believed_only_while_its_process_lives(tmp_path: Path) -> None:
    place = answer(tmp_path / "job", status="running")
    (place / "metrics.json").unlink()
    code = (
        "import sys, time\nfrom pathlib import Path\nfrom careful_io import locks\n"
        "with locks.hold_lock(Path(sys.argv[1])):\n    print('held', flush=True)\n    time.sleep(60)\n"
    )
    words = [sys.executable, "-c", code, str(RunJob(place).lock)]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "held\n"
        assert RunJob(place).look().status == "running"
        with pytest.raises(locks.TakenError), locks.hold_lock(RunJob(place).lock, wait=False):
            pass
        other.send_signal(signal.SIGKILL)
        other.wait()
    assert RunJob(place).look() == JobState("failed", jobs.KILLED, record=RunJob(place).look().record)


def test_a_job_is_done_once_and_what_a_killed_one_left_is_cleared(tmp_path: Path) -> None:
    place = tmp_path / ("d" * 16)
    place.mkdir()
    (place / ".123.plan.json").write_text("half")
    (place / "run.log").write_text("of the first attempt")
    assert RunJob(place).do_once(lambda: answer(place))
    assert not (place / ".123.plan.json").exists()
    assert (place / "run.log").exists()
    assert not RunJob(place).do_once(lambda: pytest.fail("done again"))
    assert RunJob(place).do_once(lambda: answer(place), resume=False)


def test_the_name_of_a_job_is_the_fingerprint_that_its_run_records(asked: Path) -> None:
    names = (
        "pipelines.stages=[trouble]",
        "+experiment=phi1,phi2",
        "planner=quick,dense",
        "robot.dt=900,1800.0",
    )
    done = sweep(*names, "name=plan", "seed=3", "planner.epsilon=0.02")
    assert done.returncode == 0, done.stderr
    points = sweeps.read_manifest(PLACE).points
    assert len(points) == 8
    for point in points:
        record = json.loads((PLACE / point.job / "run.json").read_text())
        assert record["config_hash"].startswith(point.job)
        assert set(record["overrides"]) >= {f"planner={point.overrides['planner']}", "seed=3"}


def test_what_no_result_depends_on_changes_no_fingerprint() -> None:
    one, two = Settings(), Settings()
    two.sweep.x, two.sweep.resume, two.planner.threads = "seed", False, 7
    assert provenance.config_hash(one) == provenance.config_hash(two)


# --- launches that break -----------------------------------------------------------------------


class Breaking:
    """A launcher that stops at the first bad job, which leaves something behind as it breaks."""

    def __init__(self, bad: Mapping[str, int], leave: Callable[[RunJob], object]) -> None:
        self.bad, self.leave = dict(bad), leave
        self.launches: list[list[str]] = []

    def __call__(self, batch: Sequence[RunJob]) -> None:
        self.launches.append([])
        for job in batch:
            self.launches[-1].append(job.name)
            if self.bad.get(job.name, 0):
                self.bad[job.name] -= 1
                self.leave(job)
                raise OSError("the launcher broke")
            answer(job.directory)

    @property
    def launched(self) -> list[str]:
        return [name for launch in self.launches for name in launch]


ALWAYS = 99
LEAVE: dict[str, Callable[[RunJob], object]] = {
    "silent": lambda _: None,
    "killed": lambda job: answer(job.directory, status="running"),
}


def runs_in(place: Path, count: int) -> list[RunJob]:
    place.mkdir(parents=True, exist_ok=True)
    return [RunJob(place / str(i)) for i in range(count)]


@pytest.mark.parametrize("kind", LEAVE)
@pytest.mark.parametrize("bad", [set(), {0}, {7}, {3, 4}, {0, 2, 4, 6}, set(range(8))])
def test_every_good_job_is_done_whichever_bad_ones_break_their_launch(
    bad: set[int], kind: str, tmp_path: Path
) -> None:
    launch = Breaking({str(i): ALWAYS for i in bad}, LEAVE[kind])
    queue = JobQueue(launch, lambda line: None)
    jobs_of_all = runs_in(tmp_path, 8)
    queue.run(jobs_of_all)
    assert set(queue.given_up) == {str(i) for i in bad}
    for i, job in enumerate(jobs_of_all):
        assert job.look().status == ("failed" if i in bad else "ok")
    assert max(launch.launched.count(str(i)) for i in range(8)) <= 5  # halving eight


def test_a_job_that_is_alone_and_killed_once_is_run_again(tmp_path: Path) -> None:
    """Whether it was alone from the start, or the last of a batch whose other jobs were killed before."""
    for count in (1, 3):
        launch = Breaking({str(i): 1 for i in range(count)}, LEAVE["killed"])
        queue = JobQueue(launch, lambda line: None)
        queue.run(runs_in(tmp_path / str(count), count))
        assert queue.given_up == {}
        assert [job.look().status for job in runs_in(tmp_path / str(count), count)] == ["ok"] * count


def test_to_be_at_work_beside_a_killed_job_costs_a_job_none_of_its_tries(tmp_path: Path) -> None:
    """Job 1 goes down with job 0, is then killed once by itself, and has its answer in the end."""
    launches: list[list[str]] = []
    kills = {"1": 1}

    def launch(batch: Sequence[RunJob]) -> None:
        launches.append([job.name for job in batch])
        for job in batch:
            answer(job.directory, status="running")
        if len(batch) > 1 or kills.pop(batch[0].name, 0):
            raise OSError("a process was killed")
        answer(batch[0].directory)

    queue = JobQueue(launch, lambda line: None)
    queue.run(runs_in(tmp_path, 2))
    assert launches == [["0", "1"], ["0"], ["1"], ["1"]]
    assert queue.given_up == {}


def test_a_job_that_a_dying_pool_has_just_begun_is_launched_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A pool raises before it kills its other processes: one of them begins job 1 after all was quiet."""
    first, second = runs_in(tmp_path, 2)
    launch = Breaking({"0": 1}, LEAVE["killed"])
    with ExitStack() as survivor:

        def begin_another(batch: Sequence[jobs.StoredJob]) -> None:
            second.directory.mkdir(exist_ok=True)
            survivor.enter_context(locks.hold_lock(second.lock, note="process 1"))

        monkeypatch.setattr(jobs, "_wait_for_survivors", begin_another)
        queue = JobQueue(launch, lambda line: None)
        queue.run([first, second])
    assert launch.launches == [["0"], ["0"], ["1"]]
    assert (first.look().status, queue.given_up) == ("ok", {})


def test_a_job_killed_twice_alone_is_given_up_and_says_so(tmp_path: Path) -> None:
    told: list[str] = []
    launch = Breaking({"0": ALWAYS}, LEAVE["killed"])
    queue = JobQueue(launch, told.append)
    (job,) = runs_in(tmp_path, 1)
    queue.run([job])
    assert launch.launches == [["0"], ["0"]]
    assert told == ["0 was killed; it is run once more"]
    assert job.look().error == "killed (the launcher broke)"


def test_what_an_earlier_sweep_left_does_not_count_as_begun(tmp_path: Path) -> None:
    """A record that says running, a second old: its job did not begin in the launch that breaks."""
    told: list[str] = []
    first, second = runs_in(tmp_path, 2)
    answer(second.directory, status="running")
    launch = Breaking({"0": 1}, LEAVE["killed"])
    JobQueue(launch, told.append).run([first, second])
    assert told == ["1 of the running jobs were killed; continuing with the others"]
    assert launch.launches == [["0"], ["1"], ["0"]]


def test_a_job_killed_before_it_wrote_anything_was_at_work(tmp_path: Path) -> None:
    """Its lock is left, with the note of the process that held it."""
    (job,) = runs_in(tmp_path, 1)
    code = (
        "import os, signal, sys\nfrom pathlib import Path\n"
        "from pareto_ltl_apps.studies.jobs import RunJob\n"
        "RunJob(Path(sys.argv[1])).do_once(lambda: os.kill(os.getpid(), signal.SIGKILL))\n"
    )

    def launch(batch: Sequence[RunJob]) -> None:
        done = subprocess.run([sys.executable, "-c", code, str(batch[0].directory)], check=False)
        raise OSError(f"exit code {done.returncode}")

    queue = JobQueue(launch, lambda line: None)
    queue.run([job])
    assert queue.given_up == {"0": "killed (exit code -9)"}
    assert job.look().error == "killed (exit code -9)"


def test_an_answer_left_beside_the_lock_of_a_killed_process_is_not_believed(tmp_path: Path) -> None:
    """Killed after it took the lock and before it cleared what it was to make again."""
    job = RunJob(answer(tmp_path / ("e" * 16)))
    assert job.settled()
    job.lock.write_text("process 1 on some machine")
    assert job.look().error == jobs.KILLED
    assert not job.settled()
    assert job.do_once(lambda: answer(job.directory))
    assert job.settled()
    assert not job.lock.exists()


def test_an_error_that_is_no_broken_launch_is_passed_on(tmp_path: Path) -> None:
    queue = JobQueue(Breaking({"0": 1}, LEAVE["killed"]), lambda line: None, breaks=(ZeroDivisionError,))
    with pytest.raises(OSError, match="the launcher broke"):
        queue.run(runs_in(tmp_path, 2))


# --- the table -------------------------------------------------------------------------------


def made(place: Path, runs: int = 200) -> SweepManifest:
    """A sweep of two settings and five seeds; the last seed of the second setting failed."""
    rng = np.random.default_rng(0)
    points = []
    for n_max in (100, 1000):
        for seed in range(5):
            point = SweepPoint(f"{n_max:08}{seed:08}", {"planner.n_max": str(n_max), "seed": str(seed)})
            points.append(point)
            directory = answer(place / point.job)
            failures = int(rng.integers(0, 6))
            write_json(
                directory / "metrics.json",
                {"completed": 1.0, "length_m": 1e6 + float(rng.normal()), "runs_independent": float(runs),
                 "failure_independent": failures / runs, "mission_failure_independent": 0.0,
                 "collision_independent": failures / runs, "run_seconds": float(rng.uniform()),
                 "nodes_per_second": None, "memory_mib": 300.0},
            )  # fmt: skip
    answer(place / points[-1].job, status="failed", error="<b>no</b> wind & no way")
    found = SweepManifest(tuple(points), ("planner.n_max", "seed"), ("+experiment=phi1",))
    found.write_to(place)
    return found


def test_rates_are_pooled_over_seeds_with_the_exact_interval(tmp_path: Path) -> None:
    rows = sweeps.sweep_rows(tmp_path, made(tmp_path))
    first, second = sweeps.seed_groups(rows)
    assert first.overrides == {"planner.n_max": "100"}
    assert (first.counts, second.counts) == ({"ok": 5}, {"ok": 4, "failed": 1})
    for group, members in ((first, rows[:5]), (second, rows[5:9])):
        failures = [round(200 * float(row.state.metrics["failure_independent"] or 0)) for row in members]
        exact = binomtest(sum(failures), 200 * len(members)).proportion_ci(0.95, "exact")
        rate = group.rates["failure_independent"]
        assert (rate["events"], rate["runs"]) == (sum(failures), 200 * len(members))
        assert [rate["low"], rate["high"]] == pytest.approx([exact.low, exact.high], abs=1e-12)
        lengths = [float(row.state.metrics["length_m"] or 0) for row in members]
        quartiles = statistics.quantiles(lengths, n=4, method="inclusive")
        assert group.quartiles["length_m"] == pytest.approx(quartiles, rel=1e-15)


def test_the_summary_tells_results_from_times(tmp_path: Path) -> None:
    made(tmp_path)
    summary.write_summary(tmp_path)
    results, times = (csv_rows(tmp_path / name) for name in ("summary.csv", "timings.csv"))
    assert list(results[0])[:5] == ["job", "planner.n_max", "seed", "status", "error"]
    assert not {name for name in results[0] if sweeps.is_clock(name)}
    assert set(times[0]) == {
        "job", "planner.n_max", "seed", "status", "run_seconds", "nodes_per_second", "memory_mib"
    }  # fmt: skip
    content = json.loads((tmp_path / "summary.json").read_text())
    assert content["counts"] == {"ok": 9, "failed": 1}
    assert [job["status"] for job in content["jobs"]] == ["ok"] * 9 + ["failed"]
    assert all(
        row["length_m"] == repr(job["metrics"]["length_m"])
        for row, job in zip(results[:9], content["jobs"][:9], strict=True)
    )


def test_the_table_comes_back_from_the_directories_alone(tmp_path: Path) -> None:
    for seed in (10, 2, 1):
        for n_max in (5, 40):
            words = ["+experiment=phi1", f"seed={seed}", f"planner.n_max={n_max}"]
            answer(tmp_path / f"job{seed}x{n_max}", overrides=words)
    found = sweeps.read_manifest(tmp_path)
    assert found.swept == ("seed", "planner.n_max")
    assert found.fixed == ("experiment=phi1",)
    order = [tuple(point.overrides.values()) for point in found.points]
    assert order == [(s, n) for s in ("1", "2", "10") for n in ("5", "40")]
    assert len(summary.write_summary(tmp_path).rows) == 6


def test_a_folder_without_jobs_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command_line(["sweep", str(tmp_path)]) == 2
    assert "holds no jobs" in capsys.readouterr().err
    assert run_command_line(["sweep", str(tmp_path / "elsewhere")]) == 2
    assert list(tmp_path.iterdir()) == []


class Cells(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.text: list[str] = []
        self.rows = self.pictures = 0
        self.fetched: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.rows += tag == "tr"
        self.pictures += tag == "svg"
        self.fetched += [str(value) for name, value in attrs if name == "src" or tag in ("link", "img")]

    def handle_data(self, data: str) -> None:
        self.text.append(data)


def test_the_page_shows_every_job_and_takes_no_error_for_markup(tmp_path: Path) -> None:
    made(tmp_path)
    summary.write_summary(tmp_path)
    source = (tmp_path / "summary.html").read_text()
    cells = Cells()
    cells.feed(source)
    assert cells.rows == (1 + 2) + (1 + 10)
    assert cells.pictures == 1
    assert "<b>no</b> wind & no way" in cells.text
    assert cells.fetched == []  # the page is whole without a network
    assert (tmp_path / "figures" / "failure_independent_over_planner.n_max.png").stat().st_size > 0


def test_the_name_of_a_folder_is_no_markup_either(tmp_path: Path) -> None:
    name = "x'><script>alert(1)<"  # what Hydra's own sweeper or a planted folder might be called
    (tmp_path / name).mkdir()
    write_json(tmp_path / name / "run.json", {"status": "<b>", "error": "<i>", "overrides": ["seed=<u>"]})
    summary.write_summary(tmp_path)
    source = (tmp_path / "summary.html").read_text()
    assert not any(f"<{mark}" in source for mark in ("script>alert", "i>", "u>"))
    assert "<b>" not in source


@pytest.mark.parametrize("job", ["../../elsewhere", "0123456789abcdef\n", "0123", "x' onclick='y", ""])
def test_only_fingerprints_name_the_jobs_of_a_sweep(tmp_path: Path, job: str) -> None:
    made(tmp_path)
    content = json.loads((tmp_path / "sweep.json").read_text())
    content["points"][0]["job"] = job
    write_json(tmp_path / "sweep.json", content)
    with pytest.raises(DataError, match="/points/0/job: expected 16 hexadecimal digits"):
        summary.write_summary(tmp_path)


def test_the_figure_is_chosen_among_the_columns(tmp_path: Path) -> None:
    made(tmp_path)
    found = summary.write_summary(tmp_path, figure=FigureChoice("seed", "length_m", "planner.n_max"))
    drawn = summary.figure_series(found, "seed", "length_m", "planner.n_max")
    assert {name: len(points) for name, points in drawn.items()} == {"100": 5, "1000": 4}
    assert (tmp_path / "figures" / "length_m_over_seed.svg").exists()
    with pytest.raises(ConfigError, match=r"sweep\.y=colour is not among the columns; there are completed"):
        summary.write_summary(tmp_path, figure=FigureChoice(y="colour"))
    assert "<svg" not in (tmp_path / "summary.html").read_text()  # the page is there, without it
    with pytest.raises(ConfigError, match=r"sweep\.x=a{10,80}\.\.\.a{10,80} is not among the columns"):
        summary.write_summary(tmp_path, figure=FigureChoice(x="a" * 100_000))


def test_numbers_keep_the_digits_that_matter() -> None:
    assert [summary.short_number(v) for v in (0.0, 12.0, 0.00123456, 1826879.93, 3.14159)] == [
        "0", "12", "0.001235", "1,826,879.9", "3.142",
    ]  # fmt: skip


def test_every_fidelity_and_law_of_the_settings_can_be_swept() -> None:
    rates = {f"{rate}_{law}" for rate in sweeps.POOLED_RATES for law in LAWS}
    metrics = dict.fromkeys(rates, 0.5) | {f"runs_{law}": 10.0 for law in LAWS}
    row = sweeps.SweepRow("job", {}, JobState("ok", metrics=metrics))
    (group,) = sweeps.seed_groups([row])
    assert set(group.rates) == rates | {"completed"}
    assert all(group.rates[name]["events"] == 5 for name in rates)


def test_files_of_a_sweep_keep_the_names_of_their_formats(tmp_path: Path) -> None:
    found = made(tmp_path)
    summary.write_summary(tmp_path)
    listed, told = (json.loads((tmp_path / name).read_text()) for name in ("sweep.json", "summary.json"))
    assert (listed["schema"], told["schema"]) == ("pareto_ltl.sweep/1", "pareto_ltl.summary/1")
    names = "\n".join(point.job for point in found.points)
    assert listed["sweep"] == told["sweep"] == hashlib.sha256(names.encode()).hexdigest()[:12]


def test_a_manifest_of_another_schema_is_refused(tmp_path: Path) -> None:
    (tmp_path / "sweep.json").write_text('{"schema": "other/9"}')
    with pytest.raises(DataError, match="read it with the version"):
        sweeps.read_manifest(tmp_path)
