"""Make or complete an environment with exactly the packages of a lock: ``environment.py VENV run|dev|EXTRA``.

``run`` has what a run needs (``requirements.lock``), ``dev`` all else too (``requirements-dev.lock``), the
name of an extra adds its packages. A marker in the environment says which of them is complete, for which lock
and Python, so that the second call of ``make`` does nothing and ``dev`` after ``run`` only adds.

The packages are installed by uv: by the one on PATH, else by one that pip fetches into the environment; if
neither works, by pip, which takes several times as long. Two calls at the same time wait for each other.
"""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from watching import watched

ROOT = Path(__file__).resolve().parents[1]
RUN, DEV = "run", "dev"
LOCKS = {RUN: "requirements.lock", DEV: "requirements-dev.lock"}
MARKERS = {RUN: ".ready-run", DEV: ".ready"}
NEEDED = {RUN: 0.8, DEV: 2.3}  # [GB] of the environment while it is made; measured: 0.68 and 2.0
CACHED = 0.8  # [GB] that uv keeps of the packages of a run
SECONDS = {"uv": {RUN: 10, DEV: 30}, "pip": {RUN: 90, DEV: 240}}  # on two cores, at 50 MB/s
INDEX = {  # settings of pip that uv has under other names; hashes make every index as good as another
    "index-url": "UV_DEFAULT_INDEX", "extra-index-url": "UV_INDEX", "find-links": "UV_FIND_LINKS",
    "no-index": "UV_NO_INDEX", "cert": "SSL_CERT_FILE", "proxy": "ALL_PROXY",
}  # fmt: skip
REASONS = (  # what installers say, and the cure
    (r"No space left|Errno 28|os error 28", "the disk is full: free some space"),
    (r"proxy", "the proxy does not let it through: check HTTPS_PROXY, or 'pip config set global.proxy URL'"),
    (
        r"(?i)resol|name or service|network|connect|timed? ?out|unreachable|no matching|not found in",
        "the package index does not answer: check the network, or name a mirror with "
        "'pip config set global.index-url URL'",
    ),
    (r"hash", "a file is not the one that the lock names: try again, or tell the maintainers"),
)


class FailedError(Exception):
    """Its text is one line: what went wrong and what to do."""


def main(words: Sequence[str]) -> int:
    """Bring the environment ``words[0]`` to the state ``words[1]``; 0, 2 after an error, 130 after Ctrl-C."""
    venv, state = Path(words[0]).absolute(), words[1]
    try:
        check_folder(venv.parent)
        with one_at_a_time(venv.parent):
            complete(venv, state)
    except FailedError as error:
        print(f"pareto_ltl: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print(f"\nstopped; 'make' begins again with {shown(venv)}", file=sys.stderr)
        return 130
    return 0


def complete(venv: Path, state: str) -> None:
    """Install what is missing for ``state``; nothing if the marker says that it is there."""
    marker = venv / MARKERS.get(state, f".ready-{state}")
    if marked(venv, state) or (state != DEV and marked(venv, DEV)):
        write_marker(marker, state)
        return
    added = (
        state == DEV and marked(venv, RUN) and not marker.exists()
    )  # with one, it has an old lock's packages
    if state in LOCKS and not added:
        create(venv, NEEDED[state])
    elif added:
        check_space(venv, NEEDED[DEV] - NEEDED[RUN])
    marker.unlink(missing_ok=True)
    (venv / MARKERS[RUN]).unlink(missing_ok=True)  # until it is complete again
    with Installer(venv) as installer:
        if state in LOCKS:
            count = len(pins(LOCKS[state]))
            installer.install(
                ["--no-deps", "--require-hashes", "-r", str(ROOT / LOCKS[state])],
                f"{count} packages of {LOCKS[state]} into {shown(venv)}", state, count,
            )  # fmt: skip
            installer.install(["--no-deps", "--editable", str(ROOT)], "pareto_ltl", state)
        else:
            names = write_text(venv / ".pins", "\n".join(f"{n}{p}" for n, p in pins(LOCKS[DEV])))
            installer.install(["-c", str(names), "--editable", f"{ROOT}[{state}]"], f"extra {state}", RUN)
            names.unlink()
    for done in {RUN, state}:
        write_marker(venv / MARKERS.get(done, f".ready-{done}"), done)


# --- markers and locks of the packages --------------------------------------------------------------


def fingerprint(state: str) -> str:
    """All that an environment in ``state`` depends on."""
    lock = (ROOT / LOCKS.get(state, LOCKS[DEV])).read_bytes()
    project = (ROOT / "pyproject.toml").read_bytes()
    return f"{base_python()} {sys.version.split()[0]} {ROOT}\n{hashlib.sha256(lock + project).hexdigest()}\n"


def marked(venv: Path, state: str) -> bool:
    """Whether the environment is complete for ``state``, as a marker says."""
    marker = venv / MARKERS.get(state, f".ready-{state}")
    with suppress(OSError, UnicodeDecodeError):
        return (python_of(venv)).exists() and marker.read_text() == fingerprint(state)
    return False


def write_marker(marker: Path, state: str) -> None:
    """Say that ``state`` is complete; ``make`` compares the time of the file."""
    write_text(marker, fingerprint(state))


def write_text(path: Path, text: str) -> Path:
    """Write ``text`` to ``path``, which is returned."""
    path.write_text(text, encoding="utf-8")
    return path


def pins(lock: str) -> list[tuple[str, str]]:
    """Name and version with marker of each package of ``lock`` that this Python and system need.

    >>> pins("requirements-dev.lock")[0][0]
    'annotated-doc'
    """
    text = (ROOT / lock).read_text(encoding="utf-8")
    return [(name, rest.rstrip(" \\")) for name, rest in re.findall(r"^([\w.-]+)(==[^\n]*)", text, re.M)]


def block(lock: str, name: str) -> str:
    """The lines of the package ``name`` in ``lock``, with its hashes."""
    text = (ROOT / lock).read_text(encoding="utf-8")
    found = re.search(rf"^{name}==.*(?:\n    .*)*", text, re.M)
    if found is None:
        raise FailedError(f"{lock} has no {name}: make it again with 'make lock'")
    return found[0] + "\n"


# --- before anything is written -----------------------------------------------------------------


def check_folder(folder: Path) -> None:
    """Raise FailedError if ``folder`` is missing or cannot be written."""
    if not folder.is_dir():
        raise FailedError(f"{folder}: no such folder; make it, or name another environment with VENV=FOLDER")
    if not writable(folder):
        raise FailedError(f"{folder} cannot be written; name another place, e.g. make demo VENV=/tmp/venv")


def writable(folder: Path) -> bool:
    """Whether a file can be made in ``folder``, which is made if it is missing."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


def check_space(venv: Path, needed: float) -> None:
    """Raise FailedError if the disk of ``venv`` has less than ``needed`` [GB]."""
    free = shutil.disk_usage(venv.parent).free / 1e9
    if free < needed:
        raise FailedError(
            f"the packages need {needed:.1f} GB in {venv.parent}, and {free:.1f} GB are free: free some "
            "space, or name a folder on another disk, e.g. make demo VENV=/mnt/venv"
        )


@contextmanager
def one_at_a_time(folder: Path) -> Iterator[None]:
    """Hold the lock of ``folder`` in the block; wait for another process that has it."""
    try:
        import fcntl  # not on Windows

        place = os.open(folder, os.O_RDONLY)
    except (ImportError, OSError):
        yield
        return
    try:
        try:
            fcntl.flock(place, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            print(f"waiting for another installation in {folder}", file=sys.stderr, flush=True)
            fcntl.flock(place, fcntl.LOCK_EX)
        except OSError:
            pass  # a network file system without locks
        yield
    finally:
        os.close(place)


# --- the environment --------------------------------------------------------------------------------


def base_python() -> str:
    """The Python that runs this, outside any environment: an active one may be what is made anew."""
    return str(getattr(sys, "_base_executable", None) or sys.executable)


def python_of(venv: Path) -> Path:
    """The interpreter in an environment."""
    return venv / "bin" / "python"


def shown(path: Path) -> str:
    """``path`` as a user would type it here."""
    with suppress(ValueError):
        return str(path.relative_to(Path.cwd()))
    return str(path)


def create(venv: Path, needed: float) -> None:
    """A new environment, in the place of an old one."""
    empty = venv.is_dir() and not any(venv.iterdir())
    if os.path.lexists(venv) and not empty and not (venv / "pyvenv.cfg").is_file():
        raise FailedError(f"{shown(venv)} is not an environment of Python: name another one with VENV=FOLDER")
    reclaimed = 0.0
    if venv.exists():
        files = (file for file in venv.rglob("*") if file.is_file() and not file.is_symlink())
        reclaimed = sum(file.stat().st_size for file in files) / 1e9
    check_space(venv, needed - reclaimed)
    if uv := shutil.which("uv"):
        command = [uv, "venv", "--quiet", "--clear", "--python", base_python(), str(venv)]
    elif pip := bundled_pip():
        command = [base_python(), "-m", "venv", "--clear", "--without-pip", str(venv)]
    else:
        command = [base_python(), "-m", "venv", "--clear", str(venv)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        said = " ".join((done.stderr + done.stdout).split())
        cure = "on Debian and Ubuntu: apt install python3-venv" if "ensurepip" in said else "see above"
        raise FailedError(f"python -m venv failed ({said[:300]}); {cure}")
    if not uv and pip:
        (packages,) = venv.glob("lib/python*/site-packages")
        with zipfile.ZipFile(pip) as wheel:
            wheel.extractall(packages)


def bundled_pip() -> str:
    """The pip that comes with Python: unpacking it takes 0.2 s, and ``venv`` takes 4 s to install it."""
    try:
        import ensurepip  # Debian has it in a package of its own
    except ImportError:
        return ""
    wheels = [str(path) for path in Path(ensurepip.__file__).parent.glob("_bundled/pip-*.whl")]
    return wheels[0] if len(wheels) == 1 else ""


class Installer:
    """Installs packages into an environment, with uv if there is one, else with pip."""

    def __init__(self, venv: Path) -> None:
        self.venv, self.python, self.uv = venv, str(python_of(venv)), ""
        self.scratch = venv / ".scratch"  # the temporary folder of a system may be small

    def __enter__(self) -> Installer:
        self.scratch.mkdir(exist_ok=True)
        self.environment: dict[str, str] = {**os.environ, "TMPDIR": str(self.scratch)}
        for name in ("PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV", "PIP_TARGET", "PIP_USER", "PIP_PREFIX"):
            self.environment.pop(name, None)
        self.uv = shutil.which("uv") or self._fetched()
        self._finish_pip()
        if self.uv:
            self._find_cache()
        return self

    def __exit__(self, *_: object) -> None:
        shutil.rmtree(self.scratch, ignore_errors=True)

    def install(self, words: list[str], what: str, state: str, total: int = 0) -> None:
        """Install ``words`` with uv; with pip if that fails for another reason than a full disk."""
        if self.uv:
            command = [self.uv, "pip", "install", "--python", self.python, *words]
            said = watched(
                command, f"{what}, with uv", SECONDS["uv"][state] if total else 0, total, self.environment
            )
            if said is None:
                return
            if reason_of(said) == REASONS[0][1]:
                raise FailedError(f"installing {what}: {REASONS[0][1]}")
            print(f"uv failed ({last_line(said)}); pip goes on", file=sys.stderr, flush=True)
            self.uv = ""
        if subprocess.run(
            [self.python, "-m", "pip", "--version"], capture_output=True, check=False
        ).returncode:
            subprocess.run([self.python, "-m", "ensurepip"], capture_output=True, check=False)
        said = watched(
            [*self._pip(), "--use-pep517", "--no-compile", *words], f"{what}, with pip",
            SECONDS["pip"][state] if total else 0, total, self.environment,
        )  # fmt: skip
        if said is not None:
            print(said.rstrip()[-3000:], file=sys.stderr)
            raise FailedError(f"installing {what}: {reason_of(said) or last_line(said)}")

    def _finish_pip(self) -> None:
        """Add the program ``pip`` where the package was only unpacked."""
        pip = bundled_pip()
        if (
            not pip
            or not list(self.venv.glob("lib/python*/site-packages/pip"))
            or (self.venv / "bin/pip").exists()
        ):
            return
        words = ["--no-index", "--no-deps", "--force-reinstall", pip]
        if self.uv:
            command = [self.uv, "pip", "install", "--quiet", "--python", self.python, *words]
        else:
            command = [*self._pip(), *words]
        subprocess.run(command, capture_output=True, check=False, env=self.environment)

    def _pip(self) -> list[str]:
        return [self.python, "-m", "pip", "install", "--disable-pip-version-check", "--progress-bar", "off"]

    def _fetched(self) -> str:
        """The uv in the environment, fetched by pip with the hashes of the lock; empty if that fails."""
        uv = self.venv / "bin" / "uv"
        if not uv.exists():
            wanted = write_text(self.scratch / "uv.lock", block(LOCKS[DEV], "uv"))
            words = ["--retries", "1", "--timeout", "20", "--no-deps", "--require-hashes", "-r", str(wanted)]
            said = watched([*self._pip(), *words], "uv, which is faster than pip", 0, 0, self.environment)
            if said is not None:
                print(
                    f"uv cannot be fetched ({reason_of(said) or last_line(said)}); pip goes on",
                    file=sys.stderr,
                )
                return ""
        self.environment |= {k: v for k, v in self._settings_of_pip().items() if k not in os.environ}
        return str(uv)

    def _settings_of_pip(self) -> dict[str, str]:
        """Index, proxy and certificates of pip, for a uv that the user did not configure."""
        command = [self.python, "-m", "pip", "config", "list"]
        listed = subprocess.run(
            command, capture_output=True, text=True, check=False, env=self.environment
        ).stdout
        found = {"UV_INDEX_STRATEGY": "unsafe-best-match"}
        for key, value in re.findall(r"^[\w:]+\.([\w-]+)='(.*)'$", listed, re.M):  # later ones win
            if key in INDEX:
                found[INDEX[key]] = " ".join(value.replace("\\n", " ").split())
        if "," not in found.get("UV_FIND_LINKS", ","):
            found["UV_FIND_LINKS"] = found["UV_FIND_LINKS"].replace(" ", ",")
        return found

    def _find_cache(self) -> None:
        """Let uv keep downloads beside the environment if its own folder is read-only or its disk is full."""
        told = subprocess.run(
            [self.uv, "cache", "dir"], capture_output=True, text=True, check=False
        ).stdout.strip()
        cache = Path(told) if told else self.scratch
        if not writable(cache) or shutil.disk_usage(cache).free < CACHED * 1e9:
            self.environment["UV_CACHE_DIR"] = str(self.scratch / "cache")


# --- what installers say -------------------------------------------------------------------------


def reason_of(said: str) -> str:
    """The cure for what an installer says; empty for what is not known."""
    return next((cure for pattern, cure in REASONS if re.search(pattern, said)), "")


def last_line(said: str) -> str:
    """The last line that says something."""
    return ([line.strip() for line in said.splitlines() if line.strip()] or ["no message"])[-1][:200]


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
