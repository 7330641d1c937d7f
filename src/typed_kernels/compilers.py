"""How numba compiles kernels and their helpers: what becomes machine code, and what of it is kept on disk.

Numba compiles every function as if Python, C and all other functions could call it. Here Python calls
kernels, kernels call helpers, and few kernels are called by both.
"""

from __future__ import annotations

from typing import Any

from llvmlite.binding import Linkage, parse_assembly
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler

OWN = ".own"  # ends the names of copies of helpers
ENVIRONMENT = "_ZN08NumbaEnv"  # begins the names of global variables with what a function may need of Python


class HelperLibrary(JITCodeLibrary):  # type: ignore[misc]  # numba has no types
    """A helper in LLVM's form, without machine code: each kernel that calls it compiles it.

    Kernels compile faster so. Numba wants the address of the environment of every function, so there is a
    module with nothing else.
    """

    def _optimize_final_module(self) -> None:
        """Inline and simplify; the rest follows once for each kernel: 4 % less of the time of a first run."""
        codegen = self._codegen
        passes, builder = codegen._module_pass_manager(  # noqa: SLF001
            loop_vectorize=codegen._loopvect,  # noqa: SLF001
            slp_vectorize=False,
            opt=codegen._opt_level,  # noqa: SLF001
            cost="cheap",
        )
        passes.run(self._final_module, builder)

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._verify_declare_only_symbols()
        engine = self.codegen._engine  # noqa: SLF001
        names = (variable.name for variable in self._final_module.global_variables)
        needed = [n for n in names if n.startswith(ENVIRONMENT) and not engine.is_symbol_defined(n)]
        module = parse_assembly("\n".join(f'@"{name}" = common global i64 0' for name in needed))
        module.data_layout = self.codegen._data_layout  # noqa: SLF001
        engine.add_module(module)
        engine.finalize_object()
        self._finalized = True


class SharedLibrary(JITCodeLibrary):  # type: ignore[misc]  # numba has no types
    """The machine code of a kernel with its own copies of the helpers that it calls.

    Numba lets the linker take the first copy in the process for all kernels. Copies differ in their last
    bits, as sums are reordered where a helper is optimised: a run that compiles would have other results
    than one that finds the code on disk, and either would depend on the order in which kernels are used.

    Copies have their own name: the linker takes a copy also for code that is compiled later by numba's usual
    compiler, and that has other arguments if LLVM has left out those that are not used.
    """

    def _finalize_final_module(self) -> None:
        for function in self._final_module.functions:
            if function.linkage == Linkage.linkonce_odr and not function.is_declaration:
                function.linkage = Linkage.internal
                function.name += OWN
        super()._finalize_final_module()


class KernelLibrary(SharedLibrary):
    """The same for a kernel that no other one calls."""

    def serialize_using_object_code(self) -> tuple[str, str, tuple[bytes, bytes]]:
        """The code as it is kept on disk, with the names that it defines.

        Numba adds all of it in LLVM's form, for other functions that call this one. It would be half of a
        file, and has to be read with it.
        """
        self._ensure_finalized()
        module = self._final_module
        names = (
            symbol.name
            for symbol in (*module.functions, *module.global_variables)
            if not symbol.is_declaration and symbol.linkage not in (Linkage.internal, Linkage.private)
        )
        text = "\n".join(f'@"{name}" = global i8 0' for name in names)
        return self.name, "object", (self._get_compiled_object(), parse_assembly(text).as_bitcode())


class LibraryCompiler(Compiler):  # type: ignore[misc]  # numba has no types
    """The usual passes, with a library of the class ``library``."""

    library: type[JITCodeLibrary]

    def define_pipelines(self) -> Any:
        """The passes, as numba asks for them."""
        state = self.state
        state.library = self.library(state.targetctx.codegen(), state.func_id.func_qualname)
        state.library.enable_object_caching()
        return super().define_pipelines()


class HelperCompiler(LibraryCompiler):
    """Compiles helpers."""

    library = HelperLibrary


class SharedCompiler(LibraryCompiler):
    """Compiles kernels that Python and other kernels call."""

    library = SharedLibrary


class KernelCompiler(LibraryCompiler):
    """Compiles kernels that Python calls."""

    library = KernelLibrary
