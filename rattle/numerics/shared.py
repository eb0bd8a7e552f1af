"""Kernels that other kernels call by name: each is compiled once, and not again into every one of its callers.

To call by name takes nanoseconds, so it suits what runs for longer. A caller's machine code has the name, which is
known to the linker before that code is compiled or loaded.
"""

import inspect
from collections.abc import Callable
from typing import Any

from llvmlite import binding
from numba.core import types
from numba.core.cgutils import get_or_insert_function, if_unlikely
from numba.core.registry import cpu_target
from numba.core.typing.templates import Signature
from numba.extending import intrinsic

from rattle.numerics.compile import Kernel, called_by_name


class Shared(Kernel):
    """A kernel of one signature, which callers do not copy."""

    def __init__(self, function: Callable[..., Any], signature: Signature, name: str) -> None:
        """Inside other kernels it goes by this name, which is to be its own."""
        super().__init__(function)
        self._name, self._signature, self._is_known = name, signature, False
        called_by_name[name] = self.provide

        def call(_context: Any, *_arguments: Any) -> tuple[Signature, Callable[..., Any]]:
            return signature, self._generate

        parameters = inspect.signature(function).parameters.values()
        context = inspect.Parameter("_context", inspect.Parameter.POSITIONAL_OR_KEYWORD)
        call.__signature__ = inspect.Signature([context, *parameters])  # type: ignore[attr-defined] # numba counts them
        self._by_name: Any = intrinsic(call)
        self._by_name._register()

    @property
    def _numba_type_(self) -> Any:
        return cpu_target.typing_context.resolve_value_type(self._by_name)

    def _generate(self, context: Any, builder: Any, signature: Signature, arguments: Any) -> Any:
        self.provide()
        returned, kinds, calls = signature.return_type, signature.args, context.call_conv
        function = get_or_insert_function(builder.module, calls.get_function_type(returned, kinds), self._name)
        status, found = calls.call_function(builder, function, returned, kinds, arguments)
        with if_unlikely(builder, status.is_error):
            calls.return_status_propagate(builder, status)
        return context.get_dummy_value() if returned is types.none else found

    def provide(self) -> None:
        """Compile or load it, and tell the linker where it is."""
        if self._is_known:
            return
        self._entry.compile(self._signature.args)
        found = self._entry.overloads[self._signature.args]
        if found.signature.return_type != self._signature.return_type:
            raise TypeError(f"{self._name} returns {found.signature.return_type}, not {self._signature.return_type}")
        binding.add_symbol(self._name, found.library.get_pointer_to_function(found.fndesc.llvm_func_name))
        self._is_known = True


def shared(signature: Signature, name: str) -> Callable[[Callable[..., Any]], Shared]:
    """A kernel that others call by this name, with arguments that are cast to those of its signature."""
    return lambda function: Shared(function, signature, name)
