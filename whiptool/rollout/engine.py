"""Which engine rolls strikes out: SIMD C++, scalar C++, or CasADi's interpreter, the best that works here."""

from __future__ import annotations

import os
from functools import lru_cache

from whiptool.dynamics.closed_loop import Structure, closed_loop
from whiptool.dynamics.swing import SwingStructure, swing
from whiptool.errors import InputError
from whiptool.rollout.batch import Engine
from whiptool.rollout.interpreter import InterpretedEngine
from whiptool.rollout.native import NativeEngine

RUNGS = ("simd", "scalar", "interpreter")
VARIABLE = "WHIPTOOL_ENGINE"


def wanted_rung() -> str | None:
    """Return the engine (`simd`, `scalar` or `interpreter`) that the environment variable sets, if any.

    Raises:
        InputError: It names no engine.
    """
    name = os.environ.get(VARIABLE) or None
    if name is not None and name not in RUNGS:
        raise InputError(VARIABLE, name, ", ".join(RUNGS))
    return name


@lru_cache(maxsize=64)
def find_engine(structure: Structure | SwingStructure, *, forward: bool, rung: str | None) -> Engine:
    """Return the fastest engine that works on this machine and simulates strikes of a structure.

    Args:
        structure: Structure of the equations of motion: of arm and whip, or of a whip on a prescribed base.
        forward: Whether the engine also computes directional derivatives.
        rung: First engine to try: `simd`, `scalar` or `interpreter`; None: `simd`.

    If SIMD code does not compile, scalar code is used; without a working compiler, the interpreter. Each is reported in
    the log.
    """
    wanted = RUNGS if rung is None else RUNGS[RUNGS.index(rung) :]
    system = closed_loop(structure) if isinstance(structure, Structure) else swing(structure)
    for name in wanted[:-1]:
        engine = NativeEngine.compiled(system, forward=forward, simd=name == "simd")
        if engine is not None:
            return engine
    return InterpretedEngine(system, forward=forward)
