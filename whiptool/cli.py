"""What the command lines share: options, parsing, and errors as one line."""

from __future__ import annotations

import dataclasses
import os
import signal
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

from whiptool import __version__
from whiptool.errors import InputError, WhiptoolError

if TYPE_CHECKING:
    from whiptool.impedance import Controller
    from whiptool.models.parameters import Model
    from whiptool.objective import Rollout, Target
    from whiptool.runs import RunFolder

T = TypeVar("T")


@dataclass(frozen=True, kw_only=True)
class SimulationOptions:
    """What is simulated, and how."""

    target: tuple[float, ...] = (1.3, 0.0)
    """Target position x y [m], from the shoulder, y up."""
    hit_radius: float = 0.06
    """The target is hit when the tip comes this close [m]."""
    t_stay: float = 0.3
    """The strike is watched this long after the movement ended [s]."""
    model: str = "lemon2024"
    """Preset (lemon2024, nah2020-n10, nah2020-n15, nah2020-n20, nah2020-fitted) or the path of a .toml file."""
    controller: str = "oiac"
    """Control law: oiac or constant (Eq. 22)."""
    preset: str = "table4"
    """OIAC parameters: printed (the paper's a = 0.2) or table4 (fitted to the errors of Table 4)."""
    feedforward: bool = False
    """Add the torque that the bare arm needs to follow the reference."""
    torque_limit: float | None = None
    """Largest joint torque [N m]."""
    control_period: float | None = None
    """Hold the torque for this long [s], as a rig does."""
    simulator: str = "compiled"
    """compiled (CasADi) or reference (MuJoCo)."""
    timestep: float | None = None
    """Integration step [s]; default: 0.00025 compiled, less for stiff whips; at most 0.0001 reference."""
    integrator: str | None = None
    """Of the reference: RK4, Euler, implicit or implicitfast; default: RK4 unless the whip is too stiff for it."""

    def build_model(self) -> Model:
        """The model that `--model` names."""
        from whiptool.models.files import find_model

        return find_model(self.model)

    def build_controller(self) -> Controller:
        """The controller that the options describe."""
        from whiptool.impedance import ConstantImpedance, Controller, oiac_preset

        if self.controller not in ("oiac", "constant"):
            raise InputError("--controller", self.controller, "oiac, constant")
        oiac = oiac_preset(self.preset)  # checked in any case
        return Controller(
            law=oiac if self.controller == "oiac" else ConstantImpedance(),
            feedforward=self.feedforward,
            torque_limit=self.torque_limit,
            control_period=self.control_period,
        )

    def build_target(self) -> Target:
        """Target position and hit radius."""
        from whiptool.objective import Target

        return Target(self.target, self.hit_radius)

    def build_rollout(self, model: Model, controller: Controller) -> Rollout:
        """The simulator that `--simulator` names."""
        if self.integrator is not None and self.simulator != "reference":
            raise InputError("--integrator", self.integrator, "nothing, unless --simulator reference is given")
        if self.simulator == "compiled":
            from whiptool.models.compiled import TIMESTEP, CompiledRollout
            from whiptool.models.modes import steady_timestep

            timestep = steady_timestep(model, TIMESTEP) if self.timestep is None else self.timestep
            return CompiledRollout(model, controller, timestep=timestep)
        if self.simulator == "reference":
            from whiptool.models.reference import ReferenceRollout

            return ReferenceRollout(model, controller, timestep=self.timestep, integrator=self.integrator)
        raise InputError("--simulator", self.simulator, "compiled, reference")

    def controller_label(self) -> str:
        """The controller in words, for people."""
        name = "constant impedance" if self.controller == "constant" else f"OIAC {self.preset}"
        return name + (" with feedforward" if self.feedforward else "")


def parse(options: type[T], *, prog: str, description: str, args: Sequence[str] | None, default: T | None = None) -> T:
    """The command line as an instance of a frozen dataclass.

    Raises:
        InputError: It does not parse; the argument is named.
        SystemExit: `--help` was printed.
    """
    import tyro
    from tyro import _errors as tyro_errors

    def refuse(event: Any) -> None:
        argument = getattr(event, "argument", None)
        name = argument.lowered.name_or_flags[0] if argument is not None else "command line"
        if isinstance(event, tyro_errors.UnrecognizedArgs):
            raise InputError("command line", " ".join(event.tokens), "the options that --help lists")
        if isinstance(event, tyro_errors.InvalidChoice):
            raise InputError(name, event.value, ", ".join(event.choices))
        if isinstance(event, tyro_errors.BadValue):
            raise InputError(name, event.offending_value, "a value (see --help)")
        if isinstance(event, tyro_errors.InstantiationFailure):
            raise InputError(name, _given(name, args), "a value of its type", event.message)
        raise InputError("command line", " ".join(args if args is not None else sys.argv[1:]), "what --help shows")

    with tyro_errors.on_parse_error(refuse):
        extra: dict[str, Any] = {} if default is None else {"default": default}
        return tyro.cli(options, prog=prog, description=description, args=args, **extra)


def parse_resumable(
    options: type[T], *, command: str, description: str, args: Sequence[str] | None, not_configuration: dict[str, Any]
) -> T:
    """As `parse`, for a command with `--out` and `--resume`: a resumed run's options come from its folder.

    Args:
        options: Their class, with fields `out` and `resume`.
        command: Its name, as in `python -m whiptool.COMMAND`.
        description, args: As in `parse`.
        not_configuration: Options that do not make the run another one, and their defaults.

    Raises:
        InputError: The folder is of another command, or an option given beside `--resume` differs from the stored one.
    """
    from whiptool.runs import read_config

    prog, words = f"whiptool {command}", list(sys.argv[1:] if args is None else args)
    parsed: Any = parse(options, prog=prog, description=description, args=words)
    if parsed.resume is None:
        return parsed
    config = read_config(parsed.resume)
    table = config.get("options")
    if config.get("command") != command or not isinstance(table, dict):
        raise InputError("--resume", str(parsed.resume), f"a folder that `{prog}` made, its config whole")
    fields: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in table.items()}
    try:
        stored = options(**fields)
    except TypeError as error:
        raise InputError("--resume", str(parsed.resume), f"a folder of {prog} ({error})") from None
    again: Any = parse(options, prog=prog, description=description, args=words, default=stored)
    if again.out is not None:
        raise InputError("--out", str(again.out), "nothing beside --resume: a resumed run stays in its folder")
    for name, value in as_plain(dataclasses.replace(again, **not_configuration)).items():
        if table.get(name, not_configuration.get(name)) != value:
            raise InputError(
                f"--{name.replace('_', '-')}",
                value,
                f"{table.get(name)!r}, as the run was begun",
                "leave it out, or start a new run",
            )
    return again


def open_folder(options: Any, name: str, config: dict) -> RunFolder:
    """The folder that a command writes its run in: a new one, or that of the run to resume.

    Args:
        options: With fields `out` and `resume`.
        name: Of a new folder, unless `--out` names it.
        config: The configuration as it is resolved now, without the version of the code.

    Raises:
        InputError: It cannot be made, another process writes in it, or it holds a run with another configuration.
    """
    from whiptool.runs import RunFolder, code_version, default_folder

    if options.resume is None:
        return RunFolder.create(
            options.out or default_folder(name), {"version": code_version(), **config}, resumable=True
        )
    folder = RunFolder.open(options.resume)
    check_same_run(folder, config)
    return folder


def check_same_run(folder: RunFolder, config: dict) -> None:
    """Refuse to go on with a run whose configuration, as it would be resolved now, is not what it was.

    Raises:
        InputError: A part differs; it is named.
    """
    stored = folder.config
    for part, value in config.items():
        if stored.get(part) != value:
            raise InputError(
                "--resume",
                str(folder.path),
                f"a run of the same {part}",
                f"the {part} is not what it was when the run was begun",
            )


def _given(flag: str, args: Sequence[str] | None) -> str:
    """What stood behind a flag on the command line."""
    words = list(args if args is not None else sys.argv[1:])
    if flag not in words:
        return ""
    behind = words[words.index(flag) + 1 :]
    return " ".join(behind[: next((i for i, word in enumerate(behind) if word.startswith("--")), len(behind))])


def run(command: Callable[[], int]) -> int:
    """Run a command: its exit status, bad input being one line on stderr and status 2."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # end as by Ctrl-C: save and summarise
    try:
        return command()
    except InputError as error:
        print(f"whiptool: {error}", file=sys.stderr)
        return 2
    except BrokenPipeError:  # the reader of our output went away
        sys.stdout = open(os.devnull, "w")  # noqa: SIM115, PTH123
        return 1
    except (WhiptoolError, OSError, MemoryError) as error:
        print(f"whiptool: {' '.join(str(error).split()) or type(error).__name__}", file=sys.stderr)
        return 1
    except KeyboardInterrupt as interruption:
        print("; ".join(["whiptool: interrupted", *getattr(interruption, "__notes__", [])]), file=sys.stderr)
        return 130


COMMANDS = {
    "optimize": "find a strike that hits a target",
    "identify": "fit a whip's parameters to recorded strikes",
    "adapt": "learn an unknown whip, strike by strike",
    "train": "train a policy over a zone of targets",
    "compare": "trials to hit, method by method",
    "reproduce": "the paper's figures and tables as one report",
    "simulate": "play one strike, or export the model",
    "view": "look at a run: viewer, video, interactive page",
    "rig": "strike with a rig, or with its twin",
    "doctor": "check the installation and this machine",
}


def main() -> int:
    """`whiptool COMMAND ...`: the same as `python -m whiptool.COMMAND ...`."""
    from importlib import import_module

    args = sys.argv[1:]
    if args[:1] == ["--version"]:
        print(f"whiptool {__version__}")
        return 0
    if not args or args[0] in ("-h", "--help"):
        print("usage: whiptool COMMAND [options]\n")
        print("\n".join(f"  {name:10s} {what}" for name, what in COMMANDS.items()))
        print("\n`whiptool COMMAND --help` lists a command's options; `whiptool --version` prints the version.")
        return 0
    if args[0] not in COMMANDS:
        return run(lambda: _unknown(args[0]))
    return import_module(f"whiptool.{args[0]}").main(args[1:])


def _unknown(command: str) -> int:
    raise InputError("command", command, ", ".join(COMMANDS))


def degrees(radians: float) -> str:
    """An angle for people: rad, and degrees beside it."""
    return f"{radians:+.4f} rad ({radians * 57.29577951308232:+.1f} deg)"


def as_plain(options: Any) -> dict:
    """Options as plain TOML data; what is None is left out."""
    plain = {}
    for f in dataclasses.fields(options):
        value = getattr(options, f.name)
        if value is not None:
            plain[f.name] = list(value) if isinstance(value, tuple) else value
    if str(plain.get("model", "")).endswith(".toml"):  # the same file, wherever the run is resumed
        plain["model"] = os.path.abspath(plain["model"])  # noqa: PTH100
    return plain
