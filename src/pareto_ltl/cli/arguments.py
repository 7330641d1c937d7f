"""Common parts of commands: an argument parser, and the conversion of errors to one line and an exit code."""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import NoReturn

from pareto_ltl.cli.output import Output, print_problem
from pareto_ltl.run.provenance import one_line
from pareto_ltl.support.errors import ConfigError, ParetoLtlError
from pareto_ltl.support.stopping import StoppedError, signals_raise

EXPECTED_ERRORS: tuple[type[Exception], ...] = (ParetoLtlError, OSError)


class CommandArguments(argparse.ArgumentParser):
    """An argument parser that raises ConfigError instead of leaving the program."""

    def error(self, message: str) -> NoReturn:
        """Raise ConfigError with ``message`` and the command for help."""
        raise ConfigError(f"{message}; see {self.prog} --help")

    def add_result(self) -> None:
        """Add the argument ``directory``, the results directory that a command reads."""
        self.add_argument(
            "directory", type=Path, metavar="DIR", help="for example outputs/phi2/2026-01-31_12-00-00"
        )

    def add_point(self) -> None:
        """Add the option ``point``, a path of the front."""
        self.add_argument("--point", metavar="N", help="path number N of front.csv; default: the plan")


def run_reported(
    work: Callable[[], int],
    expected: tuple[type[Exception], ...] = EXPECTED_ERRORS,
    describe_error: Callable[[BaseException], str] = one_line,
    output: Output = Output.TEXT,
) -> int:
    """Call ``work`` and return its exit code; for an error, print one line and return the code of the error.

    The code is 2 for an ``expected`` error, 130 for an interrupt, 143 for SIGTERM, 129 for SIGHUP, 141 for a
    closed pipe and 1 for any other error, whose line names a file with the traceback.
    """
    try:
        with signals_raise():
            code = work()
            sys.stdout.flush()  # an error of the output, e.g. a full disk, is reported too
        return code
    except SystemExit as leave:  # --help and --version of argparse
        return int(leave.code or 0)
    except BrokenPipeError:  # the reader of the output, e.g. head, has ended
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 141
    except expected as error:
        print_problem(describe_error(error), output)
        return 2
    except StoppedError as stop:
        print_problem(one_line(stop), output)
        return stop.exit_code
    except KeyboardInterrupt:
        print_problem("interrupted", output)
        return 130
    except Exception as error:
        print_problem(f"{one_line(error)} (this is a bug; the traceback is in {_write_traceback()})", output)
        return 1


def _write_traceback() -> str:
    """Write the traceback of the present error to a new temporary file; return its path."""
    handle, path = tempfile.mkstemp(prefix="pareto_ltl_", suffix=".log")
    with os.fdopen(handle, "w", encoding="utf-8") as file:
        file.write(traceback.format_exc())
    return path
