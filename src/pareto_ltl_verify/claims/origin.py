"""Claims about where a result comes from: the code that made it, and the seed of its random numbers."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path
from zlib import crc32

import numpy as np

from careful_io.fingerprints import SOURCES, code_fingerprint
from careful_io.reading import read_text
from pareto_ltl_verify.claims import Claim, Verdict, no_fault
from pareto_ltl_verify.evidence import LAWS, Evidence
from pareto_ltl_verify.laws import Independent

CODE = "run: version and commit of the code"
PLANNER = "pareto_ltl"
SOURCE = f"src/{PLANNER}"  # folder of a checkout whose fingerprint run.json has
BLOCK = 250  # flights that share a generator
ALIKE = 0.99  # least correlation of winds with the random numbers of their seed; of others it is near 0
SECONDS = 5  # that git may take
NEEDS_RERUN = (
    "that the trees, the front and the plan come from the seed and the code",
    "the commit, where this code is another one", "packages, Python, host and times of the run",
    "judged paths that are in no file", "hyperparameters of the wind", "remedies",
)  # fmt: skip


def same_code(result: Evidence) -> bool:
    """Whether the code of this installation made the result, by its fingerprint."""
    return bool(result.run.get("code_hash") == code_fingerprint())


def code(result: Evidence) -> Verdict | None:
    """Version and commit belong to the code of this installation; None if other code made the result."""
    if not same_code(result):
        return None
    run, git = result.run, result.run.get("git")
    faults = [f"version {run['version']}"] * (run["version"] != _version())
    checkout = SOURCES.name == "src" and (SOURCES.parent / "pyproject.toml").is_file()
    if git and checkout and not git.get("changed") and _differs(SOURCES.parent, str(git["commit"])):
        faults.append(f"the code of commit {git['commit'][:12]} is another one")
    return no_fault(f"version {run['version']}", faults)


def _version() -> str:
    """The version of the planner that is installed here, which is not imported."""
    stated = re.search(r'^__version__ = "(.+)"$', read_text(SOURCES / PLANNER / "__init__.py"), re.MULTILINE)
    return stated[1] if stated else "unknown"


def _differs(root: Path, commit: str) -> bool:
    """Whether the source in the checkout ``root`` is not the source of a commit which the checkout knows.

    A commit that it does not know cannot be compared.
    """
    if not commit.isalnum():
        return True
    known = _git(root, "cat-file", "-e", f"{commit}^{{commit}}")
    return known == 0 and _git(root, "diff", "--quiet", commit, "--", f"{SOURCE}/*.py") == 1


def _git(root: Path, *words: str) -> int | None:
    """The exit code of git; None if it cannot be run."""
    command = ["git", "--no-optional-locks", "-C", str(root), *words]
    try:
        done = subprocess.run(command, capture_output=True, timeout=SECONDS, check=False)
    except (OSError, subprocess.SubprocessError):
        return None
    return done.returncode


def seed(result: Evidence) -> Verdict | None:
    """Starts and winds of stored flights are the random numbers of the seed.

    Flights in independent winds with open-loop controls show the winds that they met; where the start is
    uncertain, all flights show its random numbers.
    """
    faults, checked = dict[str, bool](), 0
    for number, law in enumerate(LAWS):
        if f"{law}/x" not in result.flights:
            continue
        x = np.asarray(result.flights[f"{law}/x"], float)[:BLOCK]
        key = (crc32(b"deployment"), number, 0)
        rng = np.random.default_rng(np.random.SeedSequence(result.settings["seed"], spawn_key=key))
        start = rng.standard_normal((BLOCK, 2))[: len(x)]
        if (sd := result.robot.start_sd) > 0.0 and not result.robot.errors.start.any():
            off = np.abs((x[:, 0] - result.start) / sd - start).max()
            faults[f"starts in {law} winds"] = bool(off > 1e-6 + result.grain * 1e-3 / sd)
            checked += 1
        model = result.law(law)
        guided = result.robot.feedback > 0 or result.law("coherent").landmarks
        if isinstance(model, Independent) and not guided:
            drawn = rng.standard_normal((len(result.u), len(x), 2))
            faults[f"{law} winds"] = _unlike(result, model, x, drawn)
            checked += 1
    return no_fault(f"seed {result.settings['seed']}", faults) if checked else None


def _unlike(result: Evidence, model: Independent, x: np.ndarray, drawn: np.ndarray) -> bool:
    """Whether the winds of flights ``x`` (n, T+1, 2) do not come from the numbers ``drawn`` (T, n, 2)."""
    robot, u, met = model.robot, result.u, np.zeros_like(drawn)
    for t in range(len(u)):
        mean, latent = model.wind_at(t, x[:, t])
        wind = (x[:, t + 1] - x[:, t] @ robot.a.T) / robot.dt - u[t] @ robot.b.T
        sd = np.sqrt(model.white_variance(t, latent, 0.0))
        met[t] = np.where(sd > 1e-9, (wind - mean) / np.maximum(sd, 1e-9), drawn[t])
    return bool(np.corrcoef(met.ravel(), drawn.ravel())[0, 1] < ALIKE) if met.std() > 0.0 else False


CLAIMS: tuple[Claim, ...] = (
    Claim(CODE, (), code),
    Claim("run: seed of the flights", ("deployments.npz", "plan.json", "scene.json", "wind.nc"), seed),
)
