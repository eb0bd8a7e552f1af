"""What is compiled into its callers borrows their arrays; vectors are as wide as pays."""

from typing import Any

import numba
import numpy as np
import pytest
from numba.core.registry import cpu_target

from rattle.numerics.compile import inline, kernel


@inline
def with_its_size(numbers: Any) -> Any:
    return numbers, numbers.size


@inline
def sum_of_a_copy(numbers: Any) -> Any:
    return numbers.copy().sum()


@kernel
def size_of(numbers: Any) -> Any:
    return with_its_size(numbers)[1]


@kernel
def total(numbers: Any) -> Any:
    return sum_of_a_copy(numbers)


@inline
def perhaps(values: Any) -> Any:
    return values if values[0] > 0.0 else None


@kernel
def is_there(values: Any) -> Any:
    return perhaps(values) is not None


def test_an_inline_function_that_may_return_an_array_is_refused() -> None:
    with pytest.raises(TypeError, match="perhaps is inline and returns an array: make it a kernel"):
        is_there(np.ones(3))


def test_an_inline_function_that_returns_an_array_is_refused() -> None:
    with pytest.raises(TypeError, match="with_its_size is inline and returns an array: make it a kernel"):
        size_of(np.ones(3))


def test_an_inline_function_that_makes_an_array_is_refused() -> None:
    with pytest.raises(Exception, match="NRT required"):
        total(np.ones(3))


@pytest.mark.parametrize("features", ["+avx512f,+avx512vbmi2", "+avx512f,-avx512vbmi2", "+avx2", ""])
def test_vectors_are_wide_where_that_costs_no_clock_and_only_ours(
    features: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cpu_target.target_context.codegen(), "_tm_features", features)

    def twice(x: float) -> float:
        return x + x

    ours, others = inline(twice)._inside, numba.njit(twice)
    texts = []
    for function in (ours, others):
        function.compile((numba.float64,))
        texts += function.inspect_llvm().values()
    assert ["prefer-vector-width" in text for text in texts] == ["+avx512vbmi2" in features, False]
