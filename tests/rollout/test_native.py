"""The compiled engine, and batches in parts on threads: all of a batch once, and memory that lives long enough."""

from __future__ import annotations

import ctypes
import gc
import re
import signal
import threading
import weakref
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from processes import HANG
from rich_model import CONTROLLERS, everything

from whiptool.dynamics.closed_loop import closed_loop
from whiptool.dynamics.structure import Structure, outcome_columns, row_columns
from whiptool.dynamics.system import System
from whiptool.rollout import native
from whiptool.rollout.batch import Batch
from whiptool.rollout.native import NativeEngine, _Strikes, driver_source, generate_c, run_in_parts


class Numbers(ctypes.Structure):
    _fields_ = [("x", ctypes.c_void_p)]


@pytest.mark.parametrize("threads", [1, 3])
@pytest.mark.parametrize("count", [1, 7, 8, 64, 65, 1000])
def test_every_element_is_done_once(count, threads):
    """In parts that begin at whole groups of lanes."""
    done, firsts = np.zeros(count, int), []

    def loop(arguments, first: int, number: int) -> None:
        firsts.append(first)
        done[first : first + number] += 1

    run_in_parts(loop, Numbers(), {}, count=count, lanes=4, threads=threads)
    assert (done == 1).all()
    assert all(first % 4 == 0 for first in firsts)


@pytest.mark.slow
def test_an_interrupt_leaves_a_running_part_its_memory():
    """A part still runs when Ctrl-C unwinds its caller: its arrays outlive the call, not the part."""
    begun, may_end, unwound = threading.Event(), threading.Event(), threading.Event()
    left: list[weakref.ref] = []

    def loop(arguments, first: int, number: int) -> None:
        begun.set()
        may_end.wait(HANG)

    def call() -> None:
        x = np.zeros(1000)
        left.append(weakref.ref(x))
        arguments = Numbers(x.ctypes.data)
        threading.Thread(target=interrupt).start()
        run_in_parts(loop, arguments, {"x": x}, count=1000, lanes=4, threads=2)

    def interrupt() -> None:
        begun.wait(HANG)
        signal_main()
        while not unwound.wait(5):  # one that comes right before the wait for a part begins does not end that wait
            signal_main()

    usual = signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background jobs ignore it
    gc.collect()
    gc.disable()  # an exception that a signal raises within a finalizer is lost
    try:
        with pytest.raises(KeyboardInterrupt):
            call()
    finally:
        unwound.set()
        signal.signal(signal.SIGINT, usual)
        gc.enable()
        gc.collect()
        lived = left[0]() is not None
        may_end.set()
    assert lived
    for _ in range(200):
        gc.collect()
        if left[0]() is None:
            break
        threading.Event().wait(0.05)
    assert left[0]() is None


def signal_main() -> None:
    """What Ctrl-C does: an exception in the main thread, wherever it is."""
    signal.pthread_kill(threading.main_thread().ident, signal.SIGINT)


def test_an_error_in_a_part_is_raised():
    def loop(arguments, first: int, number: int) -> None:
        if first >= 100:
            raise ValueError("a part")

    with pytest.raises(ValueError, match="a part"):
        run_in_parts(loop, Numbers(), {}, count=1000, lanes=4, threads=2)


DRIVER = driver_source()


@pytest.fixture(scope="module")
def system() -> System:
    return closed_loop(Structure.of(everything(), CONTROLLERS["held"]))


@pytest.fixture(scope="module")
def code(system: System) -> str:
    return generate_c(system, forward=False)


def test_the_struct_has_the_drivers_members_in_their_order():
    """Types, too: pointers, 64-bit integers and doubles, as the C++ text declares them."""
    body = re.sub(r"//[^\n]*", "", re.search(r"struct Strikes \{(.*?)\n\};", DRIVER, re.DOTALL)[1])
    declared = []
    for statement in filter(None, (line.strip() for line in body.split(";"))):
        kind, names = re.match(r"(?:const )?(double|int64_t)(\*?)\s+(.*)", statement, re.DOTALL).group(1, 3)
        starred = "*" in statement
        numbers = {"double": ctypes.c_double, "int64_t": ctypes.c_int64}
        for name in names.split(","):
            declared.append((name.strip(" *\n"), ctypes.c_void_p if starred else numbers[kind]))
    assert declared == list(_Strikes._fields_)


def test_sizes_and_columns_are_constants_of_the_code(system: System, code: str):
    found = {name: int(value) for name, value in re.findall(r"constexpr int (\w+) = (\d+);", code)}
    model = everything()
    assert found["N_DRIVE"] == found["N_INPUTS"] == 2
    assert found["N_LINKS"] == model.whip.N == 12
    assert found["DIMENSION"] == 2
    assert found["NP"] == Structure.of(model, CONTROLLERS["held"]).n_parameters
    assert found["OUT"] == outcome_columns(2, 2).width
    for name, block in row_columns(model.n, 2, 2).items():
        assert found[f"ROW_{name}"] == block.start
    firsts, strides = (re.search(rf"{name}\[\] = \{{(.*?)\}}", code)[1] for name in ("LINK_FIRST", "LINK_STRIDE"))
    pairs = list(zip(map(int, firsts.split(", ")), map(int, strides.split(", ")), strict=True))
    assert pairs == list(system.link_columns.values())
    assert len(pairs) == found["LINK"]


def test_functions_are_inlined_and_comparisons_left_to_the_driver():
    """A continuous loop compares the time with the strike's duration."""
    system = closed_loop(Structure.of(everything(), CONTROLLERS["all options"]))
    code = generate_c(system, forward=False)
    for name in system.functions:
        assert f" {name}(" in code
    assert "__attribute__((always_inline))" in code
    assert not re.search(r"=\(\w+<=\w+\);", code)
    assert "=whiptool_le(" in code
    assert "whiptool_le" in DRIVER


def test_forward_mode_has_functions_with_derivatives(system: System, code: str):
    forward = generate_c(system, forward=True)
    assert len(forward) > 1.3 * len(code)
    header = re.compile(r"constexpr[^\n]*")
    assert header.findall(forward) == header.findall(code)


def test_there_is_no_engine_where_nothing_compiles(system: System, monkeypatch):
    asked = []

    def load(code: str, driver: str, defines: dict[str, Any], functions: tuple[str, ...]) -> None:
        asked.append((code, driver, defines))

    monkeypatch.setattr(native, "load_library", load)
    assert NativeEngine.compiled(system, forward=False, simd=True) is None
    [(code, driver, defines)] = asked
    assert driver == DRIVER
    assert code == generate_c(system, forward=False)
    assert (defines["HELD"], defines["SIMD"], defines["FORWARD"]) == (1, 1, 0)


def test_results_of_lanes_stand_at_their_strikes(system: System):
    """Lanes are taken longest first; a pretended driver says of each lane which strike it was given."""
    steps = np.array([3, 9, 1, 9, 5])
    B, (n, P) = len(steps), (system.n, system.n_parameters)
    p = np.tile(np.arange(float(B))[:, None], (1, P))
    batch = Batch(
        p=p, x0=np.zeros((B, 2 * n)), target=np.zeros((B, 2)), h=np.ones(B), h_last=np.ones(B), steps=steps, hold=1,
        with_rows=True, samples=2, rate=10.0,
    )  # fmt: skip
    lanes = []

    class Roll:
        restype = argtypes = None

        def __call__(self, reference: Any, first: int, count: int) -> None:
            io = reference._obj

            def array(name: str, kind: Any, *shape: int) -> np.ndarray:
                pointer = ctypes.cast(getattr(io, name), ctypes.POINTER(kind))
                return np.ctypeslib.as_array(pointer, shape)

            width = outcome_columns(2, 2).width
            given, out = array("p", ctypes.c_double, B, P), array("out", ctypes.c_double, B, width)
            path = array("path", ctypes.c_double, B, 2, 2)
            begins, taken = array("first_row", ctypes.c_int64, B), array("steps", ctypes.c_int64, B)
            rows = array("rows", ctypes.c_double, int((steps + 1).sum()), row_columns(n, 2, 2).width)
            assert (io.hold, io.samples, io.rate) == (1, 2, 10.0)
            assert io.dp is None
            for lane in range(first, first + count):
                out[lane], path[lane] = given[lane, 0], given[lane, 0]
                rows[begins[lane] : begins[lane] + taken[lane] + 1] = given[lane, 0]
                lanes.append(int(taken[lane]))

    engine = NativeEngine(SimpleNamespace(whiptool_lanes=lambda: 1, whiptool_roll=Roll()), system, "scalar")
    rolled = engine(batch, threads=1)
    assert lanes == sorted(steps, reverse=True)
    np.testing.assert_array_equal(rolled.out[:, 0], range(B))
    assert rolled.path is not None
    np.testing.assert_array_equal(rolled.path[:, 1, 0], range(B))
    assert rolled.rows is not None
    np.testing.assert_array_equal(rolled.rows[:, 0], np.repeat(range(B), steps + 1))
