"""Compilation of kernels that only other kernels call: their code is linked into that of the callers.

numba makes machine code of every function by itself, optimised, although it links the same code into each caller and
optimises it there once more. For functions that nothing else calls that was a third of the time of compiling.
"""

from typing import Any, Literal

from numba.core import ir, types
from numba.core.callconv import CPUCallConv
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import PassManager, register_pass
from numba.core.errors import TypingError
from numba.core.lowering import Lower
from numba.core.typed_passes import NativeLowering
from numba.extending import intrinsic
from numba.np import arrayobj

from kernels.symbols import jit

__all__ = ["jit_to_link"]


class _NoEngine:
    """Engine of code that is nowhere in memory."""

    def set_env(self, _name: str, _environment: object) -> None:
        """Set nothing: the callers' code has an environment of its own."""


class LinkedLibrary(JITCodeLibrary):
    """Code of one function as it is linked into its callers; no machine code, hence no address."""

    @property
    def codegen(self) -> Any:
        """The engine that holds the machine code."""
        return _NoEngine()

    def get_pointer_to_function(self, name: str) -> int:  # noqa: ARG002  # numba's signature
        """0, for no address."""
        self._ensure_finalized()
        return 0

    def _optimize_final_module(self) -> None:
        pass  # the callers' code is optimised, and this within it

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True


class LinkedLower(Lower):
    """Writer of a function's code. Where the function's indices are checked, it notes which statement it writes."""

    def lower_inst(self, inst: Any) -> None:
        """Write the code of a statement."""
        flags: Any = self.flags
        builder: Any = self.builder
        if flags.boundscheck:
            builder.statement = inst.loc, self.func_ir.func_id.func_name
        super().lower_inst(inst)


_raise = CPUCallConv.set_static_user_exc


def _raise_with_line(
    convention: Any, builder: Any, exc: Any, exc_args: Any = None, loc: Any = None, func_name: Any = None
) -> None:
    if loc is None:
        loc, func_name = getattr(builder, "statement", (None, func_name))
    _raise(convention, builder, exc, exc_args, loc, func_name)


def _generate_mismatch(_typing, source, target):
    """Signature and instructions that raise the exception of a slice, as numba's `intrinsic` takes them."""

    def generate(context, builder, _signature, _arguments):
        words = ("cannot assign slice from input of different size",)
        context.call_conv.return_user_exc(builder, ValueError, words)
        return context.get_dummy_value()

    return types.none(source, target), generate


# numba gives a line to a `raise`, but not to an index beyond an array, nor to a slice of another size than its source
CPUCallConv.set_static_user_exc = _raise_with_line  # pyright: ignore[reportAttributeAccessIssue]
arrayobj.raise_with_shape_context = intrinsic(_generate_mismatch)


@register_pass(mutates_CFG=True, analysis_only=False)
class LinkedLowering(NativeLowering):
    """Pass that writes a function's code into a `LinkedLibrary`."""

    _name = "linked_lowering"

    @property
    def lowering_class(self) -> type[Lower]:
        """Writer of the code."""
        return LinkedLower

    def run_pass(self, state: Any) -> Literal[True]:
        """Write the code of the function that is being compiled. Raises TypingError."""
        if not state.flags.nrt:
            _refuse_new_arrays(state)
        state.library = LinkedLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
        return super().run_pass(state)


def _refuse_new_arrays(state: Any) -> None:
    """Refuse a function without counted references that calls one with them for an array: nobody would free it. Raises
    TypingError."""
    for call, signature in state.calltypes.items():
        if isinstance(call, ir.Expr) and call.op == "call" and isinstance(signature.return_type, types.Array):
            callee = state.typemap[call.func.name]
            if isinstance(callee, types.Dispatcher) and callee.dispatcher.targetoptions.get("_nrt", True):
                raise TypingError(f"NRT required but not enabled: {callee} returns a new array", loc=call.loc)


class LinkingCompiler(CompilerBase):
    """numba's compiler with `LinkedLowering` in place of its own last pass."""

    def define_pipelines(self) -> list[PassManager]:
        """The passes, in one pipeline."""
        known = DefaultPassBuilder.define_nopython_pipeline(self.state)
        linked = PassManager("nopython")  # named as numba's own, which its errors name
        for each, title in known.passes:
            linked.add_pass(LinkedLowering if each is NativeLowering else each, title)
        linked.finalize()
        return [linked]


def jit_to_link(**options: Any) -> Any:
    """Decorator `numba.jit` for functions that only compiled functions call."""
    linked: dict[str, Any] = {
        "no_cpython_wrapper": True,
        "no_cfunc_wrapper": True,
        "pipeline_class": LinkingCompiler,
    }
    return jit(**linked, **options)
