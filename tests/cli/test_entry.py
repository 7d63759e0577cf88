"""When an interrupt of the command line is raised."""

import signal
import time
from collections.abc import Iterator

import llvmlite.binding as llvm
import pytest

from tactopose_drake.cli.entry import _interrupt


@pytest.fixture
def as_in_commands() -> Iterator[None]:
    before = signal.signal(signal.SIGINT, _interrupt)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("as_in_commands")
def test_an_interrupt_while_a_kernel_is_compiled_or_loaded_is_not_lost() -> None:
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    machine = llvm.Target.from_default_triple().create_target_machine()
    module = llvm.parse_assembly("define i32 @one() { ret i32 1 }")
    calls = []

    def interrupted(*_: object) -> None:
        calls.append(signal.raise_signal(signal.SIGINT))  # in a callback from C, where no exception gets out

    engine = llvm.create_mcjit_compiler(module, machine)
    engine.set_object_cache(interrupted, None)
    engine.finalize_object()
    assert calls
    began = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        time.sleep(60.0)
    assert time.monotonic() - began < 30.0  # It wakes who waits.
