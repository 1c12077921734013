"""Check of the installation and the machine, with fixes for missing parts: `python -m whiptool.doctor`."""

from __future__ import annotations

import logging
import os
import platform
import subprocess
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version

from whiptool.commands import cli
from whiptool.commands.options.option_group import JsonOptions
from whiptool.extras import EXTRAS
from whiptool.version import __version__

CORE = ("casadi", "pin", "mujoco", "nlopt", "numpy", "scipy", "matplotlib", "tyro", "pymoo", "cmaes")


@dataclass(frozen=True, kw_only=True)
class DoctorOptions(JsonOptions):
    """Check the installation and this machine."""


@dataclass(frozen=True)
class Diagnosis:
    """One line of the report: name of a check, its result, and the fix if it failed."""

    name: str
    found: str
    fix: str = ""


def _work(options: DoctorOptions) -> int:
    findings = examine()
    lines = [
        f"{'!' if f.fix else ' '} {f.name:22s} {f.found}" + (f"\n{'':25s}-> {f.fix}" if f.fix else "") for f in findings
    ]
    options.tell({f.name: {"found": f.found, "fix": f.fix} for f in findings}, "\n".join(lines))
    return int(any(f.name in CORE and f.fix for f in findings))


_EXAMPLE = "Check the installation and this machine. Example: python -m whiptool.doctor"
main = cli.command(DoctorOptions, "doctor", _EXAMPLE, _work)  # the exit status is 0 unless a core package is missing


def examine() -> list[Diagnosis]:
    """Return all findings, in the order in which they are printed."""
    findings = [
        Diagnosis("whiptool", __version__),
        Diagnosis("Python", f"{platform.python_version()} on {platform.system()} {platform.machine()}"),
    ]
    findings += [_package(name) for name in CORE]
    findings += [_extra(extra, packages.values()) for extra, packages in EXTRAS.items()]
    return [*findings, *_camera(), _processor(), *_engine(), _cache(), _graphics()]


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None


def _package(name: str) -> Diagnosis:
    found = _version(name)
    return Diagnosis(name, found or "not installed", "" if found else "pip install whiptool")


def _extra(extra: str, names: Iterable[str]) -> Diagnosis:
    """Optional packages: what is missing is named, and is not a defect."""
    versions = {name: _version(name) for name in names}
    missing = not all(versions.values())
    found = ", ".join(f"{name} {found or 'not installed'}" for name, found in versions.items())
    return Diagnosis(f"extra {extra}", found + (f"; if needed: pip install 'whiptool[{extra}]'" if missing else ""))


def _camera() -> list[Diagnosis]:
    """Whether what is installed for the RealSense camera loads: its wheel does not hold the USB library."""
    from whiptool.errors import InputError
    from whiptool.vision.source import realsense

    if _version("pyrealsense2") is None:
        return []
    try:
        realsense()
    except InputError as error:
        return [Diagnosis("RealSense", str(error.given), error.fix)]
    return [Diagnosis("RealSense", "pyrealsense2 loads")]


def _processor() -> Diagnosis:
    from whiptool.rollout.native import cores

    return Diagnosis("cores", str(cores()))


def _engine() -> list[Diagnosis]:
    """Compiler, and the engine that strikes really run on here."""
    from whiptool.impedance import ConstantImpedance, Controller
    from whiptool.models import preset
    from whiptool.rollout import CompiledRollout
    from whiptool.rollout.compiler import CompilerHangs, compiler_version, find_compiler
    from whiptool.rollout.engine import VARIABLE, wanted_rung
    from whiptool.rollout.native import NativeEngine

    logging.getLogger("whiptool").setLevel(logging.ERROR)  # the findings say it
    compiler, forced = find_compiler(), wanted_rung()
    if compiler is None:
        compiler_finding = Diagnosis("C++ compiler", "none", "install g++ (Debian: apt-get install g++), or set CXX")
    else:
        try:
            version = (compiler_version(compiler).splitlines() or ["?"])[0]
            compiler_finding = Diagnosis("C++ compiler", f"{compiler}: {version}")
        except CompilerHangs as error:
            compiler_finding = Diagnosis("C++ compiler", f"{compiler}: {error}", "set CXX to a compiler that works")
    rollout = CompiledRollout(preset("lemon2024"), Controller(ConstantImpedance()))
    engine = rollout._engine(forward=False)
    lanes = f", {engine.lanes} strikes at a time on each core" if isinstance(engine, NativeEngine) else ""
    fix = ""
    if compiler is not None and rollout.engine != "simd" and forced is None:
        fix = "the compiler fails on the generated code: see the log of `whiptool optimize`"
    by = f" (forced by {VARIABLE})" if forced else ""
    return [compiler_finding, Diagnosis("engine", rollout.engine + lanes + by, fix)]


def _cache() -> Diagnosis:
    from whiptool.rollout.compiler import cache_folder

    folder = cache_folder()
    libraries = list(folder.glob("*.so"))
    size = sum(path.stat().st_size for path in libraries) / 1e6
    return Diagnosis("compiled code", f"{folder}: {len(libraries)} libraries, {size:.1f} MB")


def _graphics() -> Diagnosis:
    """Whether MuJoCo can draw here."""
    program = (
        "import mujoco; m = mujoco.MjModel.from_xml_string('<mujoco/>'); r = mujoco.Renderer(m, 16, 16);"
        "d = mujoco.MjData(m); mujoco.mj_forward(m, d); r.update_scene(d); r.render(); r.close()"
    )

    fix = "videos are drawn by matplotlib; for MuJoCo's pictures install EGL (Debian: apt-get install libegl1 libgl1)"
    for backend in dict.fromkeys([os.environ.get("MUJOCO_GL") or "egl", "egl", "glfw"]):
        command = [sys.executable, "-c", program]
        try:
            run = subprocess.run(
                command, env={**os.environ, "MUJOCO_GL": backend}, capture_output=True, timeout=60, check=False
            )
        except subprocess.TimeoutExpired:
            continue
        if run.returncode == 0:
            return Diagnosis("OpenGL", backend)
    return Diagnosis("OpenGL", "no context", fix)
