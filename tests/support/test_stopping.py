"""Requests to end: an exception in the main thread, passed on to child processes, and no second one."""

from __future__ import annotations

import ctypes
import os
import signal
import subprocess
import sys
import threading
import time

import pytest

from pareto_ltl_apps.stopping import SIGNALS, StoppedError, signals_raise
from patience import PATIENCE


@pytest.mark.parametrize("number", SIGNALS)
def test_a_request_to_end_is_an_exception_with_the_exit_code_of_its_signal(number: int) -> None:
    before = signal.getsignal(number)
    signal.signal(number, signal.default_int_handler)  # under nohup a signal is ignored, and stays so
    try:
        with pytest.raises(StoppedError) as caught, signals_raise():
            os.kill(os.getpid(), number)
        assert signal.getsignal(number) is signal.default_int_handler
    finally:
        signal.signal(number, before)
    assert caught.value.exit_code == 128 + number
    assert str(caught.value) == f"stopped by {signal.Signals(number).name}"


def test_a_second_request_does_not_interrupt_the_clean_up() -> None:
    cleaned: list[bool] = []

    def work() -> None:
        try:
            os.kill(os.getpid(), signal.SIGTERM)
        finally:
            os.kill(os.getpid(), signal.SIGTERM)
            cleaned.append(True)

    with pytest.raises(StoppedError), signals_raise():
        work()
    assert cleaned == [True]


@pytest.mark.parametrize("number", [signal.SIGINT, *SIGNALS])
@pytest.mark.parametrize("place", ["called by C", "finaliser"])
def test_a_signal_where_python_cannot_pass_on_its_exception_comes_again(number: int, place: str) -> None:
    before = signal.getsignal(number)
    signal.signal(number, signal.default_int_handler)
    sent: list[bool] = []

    def send() -> None:
        sent.append(True)
        os.kill(os.getpid(), number)

    class Owner:
        def __del__(self) -> None:
            send()

    def work() -> None:
        if place == "finaliser":
            Owner()
        else:
            ctypes.CFUNCTYPE(None)(send)()
        for _ in range(100):  # it goes on, as nothing has told it to end
            time.sleep(0.1)

    try:
        with pytest.raises(KeyboardInterrupt) as caught, signals_raise():
            work()
    finally:
        signal.signal(number, before)
    assert sent == [True]
    assert getattr(caught.value, "number", signal.SIGINT) == number


def test_an_error_that_follows_from_a_lost_signal_does_not_hide_it() -> None:
    def work() -> None:
        ctypes.CFUNCTYPE(None)(lambda: os.kill(os.getpid(), signal.SIGTERM))()
        raise RuntimeError("no result of the callback")

    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        with pytest.raises(StoppedError), signals_raise():
            work()
        time.sleep(0.2)  # no signal follows
    finally:
        signal.signal(signal.SIGTERM, before)


def test_other_lost_exceptions_are_shown_as_before(capsys: pytest.CaptureFixture[str]) -> None:
    def fault() -> None:
        raise ValueError("of a callback")

    hook = sys.unraisablehook
    with signals_raise():
        ctypes.CFUNCTYPE(None)(fault)()
    assert sys.unraisablehook is hook
    assert "ValueError: of a callback" in capsys.readouterr().err


def test_a_signal_that_was_ignored_stays_ignored() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with signals_raise():
            os.kill(os.getpid(), signal.SIGHUP)
    finally:
        signal.signal(signal.SIGHUP, before)


def test_a_thread_that_may_set_no_handler_runs_the_block() -> None:
    ran: list[bool] = []

    def work() -> None:
        with signals_raise():
            ran.append(True)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert ran == [True]


def test_child_processes_are_asked_to_end_first() -> None:
    child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
    with pytest.raises(StoppedError), signals_raise():
        os.kill(os.getpid(), signal.SIGTERM)
    assert child.wait(timeout=PATIENCE) == -signal.SIGTERM
