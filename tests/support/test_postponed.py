"""Imports that are postponed to the first use."""

from __future__ import annotations

import sys

import pytest

from pareto_ltl.support.postponed import postponed


@pytest.fixture
def module(tmp_path, monkeypatch):
    name = "slow_module_of_a_test"
    (tmp_path / f"{name}.py").write_text("def double(x):\n    return 2 * x\n\n\nSIZE = 3\n", encoding="utf-8")
    monkeypatch.syspath_prepend(str(tmp_path))
    yield name
    sys.modules.pop(name, None)


def test_a_postponed_module_is_imported_when_its_function_is_called(module):
    with postponed(module, ("double",)):
        double = __import__(module, fromlist=["double"]).double
    assert module not in sys.modules
    assert double(4) == 8
    assert module in sys.modules


def test_what_was_not_postponed_imports_the_module_at_once(module):
    with postponed(module, ("double",)):
        assert __import__(module, fromlist=["SIZE"]).SIZE == 3
    assert sys.modules[module].SIZE == 3


def test_a_module_that_was_imported_before_stays(module):
    before = __import__(module)
    with postponed(module, ("double",)):
        assert sys.modules[module] is before
    assert sys.modules[module] is before


def test_a_name_that_the_module_lacks_is_an_error(module):
    with postponed(module, ()), pytest.raises(AttributeError, match="absent"):
        _ = __import__(module, fromlist=["SIZE"]).absent
