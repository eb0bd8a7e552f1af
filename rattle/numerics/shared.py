"""Kernels that other kernels call, each compiled once and not again into every one of its callers.

A caller's machine code names a place, which the linker knows from the import of this module on: where the kernel is,
once it is compiled or loaded, and what does that on the first call. To call it takes a nanosecond more than a copy, so
this suits what runs for longer. docs/decisions/0052-shared-kernels.md
"""

import ctypes
import inspect
from collections.abc import Callable
from typing import Any

from llvmlite import binding, ir
from numba.core import types
from numba.core.cgutils import gep_inbounds, if_unlikely, is_null, voidptr_t
from numba.core.registry import cpu_target
from numba.core.typing.templates import Signature
from numba.extending import intrinsic

from rattle.numerics.compile import Kernel

KERNEL, PROVIDE = range(2)  # of a place
PLACE = ir.ArrayType(voidptr_t, 2)


class Shared(Kernel):
    """A kernel of one signature, which callers do not copy."""

    def __init__(self, function: Callable[..., Any], signature: Signature) -> None:
        """Inside other kernels its arguments are cast to those of the signature."""
        super().__init__(function)
        self._name, self._signature = f"{function.__module__}.{function.__qualname__}", signature
        self._provide = ctypes.CFUNCTYPE(None)(self.provide)
        self._place = (ctypes.c_void_p * 2)(None, ctypes.cast(self._provide, ctypes.c_void_p))
        binding.add_symbol(self._name, ctypes.addressof(self._place))

        def call(_context: Any, *_arguments: Any) -> tuple[Signature, Callable[..., Any]]:
            return signature, self._generate

        parameters = inspect.signature(function).parameters.values()
        context = inspect.Parameter("_context", inspect.Parameter.POSITIONAL_OR_KEYWORD)
        call.__signature__ = inspect.Signature([context, *parameters])  # type: ignore[attr-defined] # numba counts them
        self._inside_others: Any = intrinsic(call)
        self._inside_others._register()

    @property
    def _numba_type_(self) -> Any:
        return cpu_target.typing_context.resolve_value_type(self._inside_others)

    def provide(self) -> None:
        """Compile or load it, unless that was done before."""
        if self._place[KERNEL] is None:
            found = self.compiled(self._signature.args)
            is_returned, is_promised = found.signature.return_type, self._signature.return_type
            if is_returned != is_promised:
                raise TypeError(f"{self._name} returns {is_returned}, not {is_promised}")
            self._place[KERNEL] = found.library.get_pointer_to_function(found.fndesc.llvm_func_name)

    def _generate(self, context: Any, builder: Any, signature: Signature, arguments: Any) -> Any:
        place = builder.module.globals.get(self._name) or ir.GlobalVariable(builder.module, PLACE, self._name)

        def at(number: int) -> Any:
            return builder.load(gep_inbounds(builder, place, 0, number))

        returned, kinds, calls = signature.return_type, signature.args, context.call_conv
        with if_unlikely(builder, is_null(builder, at(KERNEL))):
            builder.call(builder.bitcast(at(PROVIDE), ir.FunctionType(ir.VoidType(), []).as_pointer()), [])
            with if_unlikely(builder, is_null(builder, at(KERNEL))):  # what is wrong has been printed
                calls.return_user_exc(builder, RuntimeError, (f"{self._name} cannot be compiled",))
        function = builder.bitcast(at(KERNEL), calls.get_function_type(returned, kinds).as_pointer())
        status, found = calls.call_function(builder, function, returned, kinds, arguments)
        with if_unlikely(builder, status.is_error):
            calls.return_status_propagate(builder, status)
        return context.get_dummy_value() if returned is types.none else found


def shared(signature: Signature) -> Callable[[Callable[..., Any]], Shared]:
    """A kernel of this signature that others call, and do not copy."""
    return lambda function: Shared(function, signature)
