"""From LLVM's text to machine code, and from there to addresses."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, nullcontext
from functools import cache
from typing import Any

import llvmlite.binding as llvm

from ...errors import one_of

WIDER = {
    512: (),
    256: ("avx512",),
    128: ("avx", "fma", "f16c", "vaes", "vpclmulqdq", "sha512", "sm3", "sm4", "xop"),
}
"""Features, by the beginning of their names, that programs of at most so many bits a
vector do without: some of them bring AVX back.
"""

CHOICES = {
    "disable-select-optimize": ("false", "true"),
    "enable-if-conversion": ("false", "true"),
    "mispredict-default-rate": (20, 25),
    "unswitch-threshold": (400, 50),
}
"""LLVM's options while we compile, and its own.

A condition that a recursion waits for becomes a branch: processors predict it, because
it mostly holds as it did a sample before.  A condition on parameters alone is decided
before the loop, even if the loop is long.  Loops with branches stay without vectors:
of a number that stays the same in a loop, LLVM walks along each way that leads to it,
of which there are twice as many after each sum of a number with itself.
"""


def features() -> list[str]:
    """Return the CPU features for which programs are built.

    They are those of the processor, except what STIMLIB_VECTOR_BITS = 256 or 128
    excludes, and LLVM's preference of 256 bits on some processors with AVX-512: tables
    take 0.54 to 0.76 of their time in 512.
    """
    # an entry's name has the features, so one cache holds code of several widths
    bits = os.environ.get("STIMLIB_VECTOR_BITS") or "512"
    one_of("STIMLIB_VECTOR_BITS", bits, [*map(str, WIDER)])
    present = llvm.get_host_cpu_features().flatten().split(",")
    return [
        "-" + feature[1:] if feature[1:].startswith(WIDER[int(bits)]) else feature
        for feature in present
    ] + ["-prefer-256-bit"] * ("+avx512f" in present)


FEATURES = features()


@cache
def _target() -> llvm.Target:
    # once per process, when something is compiled or loaded
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    target = llvm.Target.from_triple(llvm.get_process_triple())
    # the first one makes the functions of the process known to LLVM
    _engines.append(
        llvm.create_mcjit_compiler(llvm.parse_assembly(""), target.create_target_machine())
    )
    return target


def _target_machine() -> llvm.TargetMachine:
    """Return this processor, as LLVM compiles for it."""
    target = _target()
    # a new one for each use: an engine owns the one that it gets
    return target.create_target_machine(
        cpu=llvm.get_host_cpu_name(),
        features=",".join(FEATURES),
        opt=3,
        # MCJIT relocates nothing on x86
        reloc="static" if target.name.startswith("x86") else "default",
        codemodel="jitdefault",
        jit=True,
    )


# Machine code -------------------------------------------------------------------------
def optimised(text: str, ours: bool) -> llvm.ModuleRef:
    """Return LLVM's text after optimisation for this processor; ours: with CHOICES."""
    machine = _target_machine()
    module = llvm.parse_assembly(text)
    # a text says nothing of the machine
    module.triple, module.data_layout = machine.triple, str(machine.target_data)
    with choices() if ours else nullcontext():
        # of the runtime, level 3 makes larger code in twice the time, no faster
        tuning = llvm.create_pipeline_tuning_options(speed_level=3 if ours else 2)
        tuning.loop_vectorization, tuning.slp_vectorization = True, False
        builder = llvm.create_pass_builder(machine, tuning)
        builder.getModulePassManager().run(module, builder)
    return module


def machine_code(text: str, ours: bool) -> tuple[bytes, list[str]]:
    """Return the object code of a text, and the names that it calls."""
    module = optimised(text, ours)
    with choices() if ours else nullcontext():
        code = _target_machine().emit_object(module)
    # to be looked for before the code is loaded, by whoever reads it from the cache
    calls = [
        function.name
        for function in module.functions
        if function.is_declaration and function.name[:5] != "llvm."
    ]
    return code, calls


@contextmanager
def choices() -> Iterator[None]:
    """Compile segments with our options of LLVM, while a numba beside us does not.

    The runtime gains nothing from them, and would take a quarter longer to compile.
    """
    numba: Any = sys.modules.get("numba.core.compiler_lock")
    # options are global to LLVM, and numba may bind the same LLVM
    with numba.global_compiler_lock if numba else nullcontext():
        try:
            _choose(0)
            yield
        finally:
            _choose(1)


def _choose(turn: int) -> None:
    """Set the options of LLVM for our code (0), or for others (1)."""
    for name, values in CHOICES.items():
        llvm.set_option("", f"-{name}={values[turn]}")


# Addresses ----------------------------------------------------------------------------
_engines: list[Any] = []  # whose code lives as long as the process


def addresses(code: bytes, names: Iterable[str]) -> dict[str, int]:
    """Load object code, and return where these of its functions are.

    Raises
    ------
    LookupError
        It has no such function.
    """
    # an engine of its own for each entry: names such as _sl_segment are in all of them
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), _target_machine())
    _engines.append(engine)
    engine.add_object_file(llvm.ObjectFileRef.from_data(code))
    engine.finalize_object()
    found = {name: engine.get_function_address(name) for name in names}
    if not all(found.values()):
        raise LookupError(f"the code has no {min(found, key=found.__getitem__)}")
    return found


def missing(calls: Iterable[str]) -> list[str]:
    """Return the functions that this process does not have.

    LLVM would end the process over one of them.
    """
    _target()
    return [name for name in calls if not llvm.address_of_symbol(name)]
