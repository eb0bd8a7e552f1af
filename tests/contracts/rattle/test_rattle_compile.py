"""Inlined kernels borrow the arrays of their callers; numba's own functions are left alone."""

from importlib import import_module
from pkgutil import walk_packages
from typing import Any

import numba
import numpy as np
import pytest

import rattle
from rattle import RattleError
from rattle.numerics import compile as compiling
from rattle.numerics.compile import inline, kernel
from rattle.orbits import return_map

NUMBERS = (numba.float64[::1],)


@inline
def sum_of_a_copy(numbers: Any) -> Any:
    return numbers.copy().sum()


@kernel
def total(numbers: Any) -> Any:
    return sum_of_a_copy(numbers)


def with_its_size(numbers: Any) -> Any:
    return numbers, numbers.size


def perhaps(values: Any) -> Any:
    return values if values[0] > 0.0 else None


@pytest.mark.parametrize("function", [with_its_size, perhaps])
def test_an_inline_function_that_returns_an_array_is_refused(function: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compiling.InlineFunction, "compiled", [])
    compiled = inline(function)
    compiling.refuse_array_returns()
    compiled.kernel_dispatcher.compile(NUMBERS)
    with pytest.raises(RattleError, match=f"{function.__name__} is inline and returns an array: make it a kernel"):
        compiling.refuse_array_returns()


def test_an_inline_function_that_makes_an_array_is_refused() -> None:
    with pytest.raises(Exception, match="NRT required"):
        total(np.ones(3))


def test_an_inline_function_is_the_plain_one_from_python() -> None:
    assert inline(with_its_size)(np.ones(2))[1] == 2
    assert inline(with_its_size).__name__ == "with_its_size"


def test_where_numba_keeps_functions_of_others_is_left_as_it_was() -> None:
    assert str(compiling.cache_directory()) != numba.config.CACHE_DIR


def test_functions_found_by_a_type_are_those_that_the_table_lists() -> None:
    """Every gear provides each of them that it has, from the module that the docstring of `return_map` says."""
    assert rattle.inelastic
    documented = {}
    for line in (return_map.__doc__ or "").splitlines():
        match line.split():
            case [function, declared, *gears] if "." in declared and len(gears) == 3:
                rooms = zip(("impacting", "stiff", "inelastic"), gears, strict=True)
                modules = {f"rattle.{room}.{module}" for room, module in rooms if module != "none"}
                documented[f"rattle.{declared}.{function}"] = modules
    found = {
        f"{function.__module__}.{function.__name__}": {each.__module__ for each in implementations.values()}
        for function, implementations in compiling.FOR_TYPES.items()
        if function.__module__.startswith("rattle.")
    }
    assert found == documented


def test_a_process_that_compiles_finds_every_kernel_by_its_name() -> None:
    names = [found.name for found in walk_packages(rattle.__path__, "rattle.")]
    modules = [import_module(name) for name in names if ".proof" not in name]
    kernels = [each for module in modules for each in vars(module).values() if isinstance(each, compiling.Kernel)]
    assert len(kernels) > 100
    assert all(getattr(import_module(each.__module__), each.name) is each for each in kernels)
