"""Settings of all tests: no deadline for compiled code, the same examples every time, a separate cache."""

from __future__ import annotations

import gc
import logging
import os
import signal
import sys
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings

from levels import AT_NIGHT, BY_DAY, SAMPLE, SAMPLE_SECONDS, UNCOMPILED, left_out, of_this_level

# Tests start hundreds of processes, which would else compile the same modules again and again.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False
# A shell starts what runs in its background with these ignored, and so would all processes of the tests.
for name, usual in (("SIGINT", signal.default_int_handler), ("SIGHUP", signal.SIG_DFL)):
    if hasattr(signal, name) and signal.getsignal(getattr(signal, name)) is signal.SIG_IGN:
        signal.signal(getattr(signal, name), usual)

BEGAN = time.monotonic()
MODULES = 20  # of the longest ones that are shown
examples = 100 if AT_NIGHT else 10 if BY_DAY and not UNCOMPILED else 25
settings.register_profile("house", deadline=None, derandomize=True, database=None, max_examples=examples)
settings.load_profile("house")


def pytest_ignore_collect(collection_path: Path) -> bool | None:
    """Leave out the modules of other levels, unread."""
    return (collection_path.suffix == ".py" and left_out(collection_path)) or None


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out the tests of other levels."""
    chosen = of_this_level(items)
    among = set(chosen)
    config.hook.pytest_deselected(items=[item for item in items if item not in among])
    items[:] = chosen


def pytest_collection_finish() -> None:
    """Thousands of tests and modules stay to the end: the search for garbage passes them over."""
    gc.collect()
    gc.freeze()


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup() -> None:
    """A sample of the night ends in time; what is not begun then is counted as skipped."""
    if SAMPLE and time.monotonic() - BEGAN > SAMPLE_SECONDS:
        pytest.skip("beyond the time of a sample of the night")


def pytest_terminal_summary(terminalreporter: Any, config: pytest.Config) -> None:
    """With ``--durations``, also the modules that take longest: what to shorten, or to run at night."""
    if not config.getoption("durations"):
        return
    spent = Counter[str]()
    for report in (one for reports in terminalreporter.stats.values() for one in reports):
        if isinstance(report, pytest.TestReport):
            spent[report.nodeid.partition("::")[0]] += report.duration
    terminalreporter.write_sep("=", "longest modules")
    for module, seconds in spent.most_common(MODULES):
        terminalreporter.write_line(f"{seconds:.1f}s {module}")


@pytest.fixture(scope="session", autouse=True)
def _own_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Give tests their own cache, shared by pytest's processes, instead of the user's."""
    before = os.environ.get("PARETO_LTL_CACHE")
    folder = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        folder = folder.parent  # each process has a separate folder in it
    os.environ["PARETO_LTL_CACHE"] = str(folder / "cache")
    yield
    if before is None:
        del os.environ["PARETO_LTL_CACHE"]
    else:
        os.environ["PARETO_LTL_CACHE"] = before


@pytest.fixture(autouse=True)
def _own_log_handlers() -> Iterator[None]:
    """Remove handlers that a test adds to the root logger: they write into captured streams."""
    root = logging.getLogger()
    for handler in list(root.handlers):
        if getattr(getattr(handler, "stream", None), "closed", False):
            root.removeHandler(handler)
    before, level = list(root.handlers), root.level
    yield
    for handler in set(root.handlers) - set(before):
        root.removeHandler(handler)
    root.setLevel(level)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """With ``-n``, run the tests of a file in one process, which makes the fixtures of the file once."""
    from xdist.scheduler import WorkStealingScheduling

    return WorkStealingScheduling(config, log) if config.getoption("dist") == "load" else None
