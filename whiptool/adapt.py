"""Learn an unknown whip, strike by strike: `python -m whiptool.adapt --target X Y --port twin --camera twin`."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from whiptool import cli
from whiptool.errors import InputError
from whiptool.options import refuse_idle, whole
from whiptool.rig.command import ArmOptions
from whiptool.whole_files import write_whole

if TYPE_CHECKING:
    from whiptool.adaptation.loop import Adaptation, Step
    from whiptool.adaptation.prior import Belief

CAMERAS = ("tip", "points", "twin", "d435-color", "d435-infrared")
SLOW = 0.9  # [s], shortest movement within a motor's limits
UNFELT = 0.01  # part of a motor's line that is left for the drag and dry friction that a check leaves out
FASTEST_TIP = 343.0  # [m/s], of sound: where a whip cracks
REPORT = "report.html"


@dataclass(frozen=True, kw_only=True)
class AdaptOptions(ArmOptions):
    """Strike, film, identify again and plan again, until an unknown whip hits."""

    camera: str = "points"
    """With the twin: points (the tip with the error of tracked images), twin or d435-infrared (rendered and tracked
    images), d435-color (the same in colour), tip (60 frames a second, 5 mm noise, no servos); with a real arm:
    realsense or a RealSense recording (.db3)."""
    family: str = "strange"
    """Of the twin's whip: kin (uniform), strange (tapered, a bead, a soft joint and more), stranger (twice that)."""
    material: str | None = None
    """What the whip is made of: cotton, leather, nylon, silicone, steel-chain. Its numbers are then believed to be
    those of the material, else those of --model, and as uncertain as those of materials."""
    diameter: float | None = None
    """Of a whip of --material, measured; of a chain that of its wire [m]."""
    length: float | None = None
    """Of a whip of --material, measured [m]."""
    max_strikes: int = 6
    """No more strikes than these; a look before the first one is none."""
    whip: str = "profile"
    """What is learned: profile (tapers, drag, friction, rest curvature) or uniform (k, b, m, l)."""
    prior: str | None = None
    """TOML file of lines such as "profile.length" = {value = 0.9, error = 0.05}, laid over the wide default: what it
    does not name stays as it is."""
    known: tuple[str, ...] = ()
    """Recordings (.npz) of earlier strikes with the same whip."""
    limits: str | None = None
    """Plan within a motor's limits: xm430, the default but for --camera tip, which has no motors."""
    still: bool = True
    """Film the whip as it hangs, before the first strike: how long it is. Not needed with --wiggle or --known."""
    wiggle: bool = False
    """A short, slow movement first, chosen for what it tells about the whip."""
    starts: int = 3
    """Starts of every identification."""
    least_speed: float = 0.0
    """The tip is at least this fast at the closest approach, on the whip that is believed [m/s]."""
    out: Path | None = None
    """Run folder; default: runs/adapt-DATE-TIME."""
    seed: int = 0
    """Of the twin's whip and of everything random."""
    resume: Path | None = None
    """Go on with the run in this folder: its strikes are not struck again."""

    def check(self) -> None:
        """As `Options.check`."""
        from whiptool.adaptation.prior import WHIPS
        from whiptool.adaptation.twins import FAMILIES
        from whiptool.models.parameters import number
        from whiptool.rig.limits import limits_preset

        super().check()
        if self.port == "twin" and self.camera not in CAMERAS:
            raise InputError("--camera", self.camera, ", ".join(CAMERAS) + " with --port twin")
        if self.port != "twin" and self.camera != "realsense" and not self.camera.endswith(".db3"):
            raise InputError("--camera", self.camera, "realsense or a .db3 recording, with a real arm")
        self._refuse_idle()
        _stock(self)
        for name, given, known in (("--family", self.family, FAMILIES), ("--whip", self.whip, WHIPS)):
            if given not in known:
                raise InputError(name, given, ", ".join(known))
        if self.limits is not None:
            limits_preset(self.limits)
        number("--least-speed", self.least_speed, low=0, high=FASTEST_TIP)
        whole("--max-strikes", self.max_strikes)
        whole("--starts", self.starts, high=1000)

    def _refuse_idle(self) -> None:
        """Options that would change nothing are not taken for ones that did."""
        idle: dict[str, str] = {}
        if self.port == "twin":
            idle |= dict.fromkeys(("approach_speed", "settle"), "nothing: the twin stands where its strike begins")
            if self.camera == "tip":
                idle |= dict.fromkeys(("rate", "friction", "latency"), "nothing with --camera tip, which has no servos")
        else:
            idle["family"] = "nothing, unless --port twin is given"
        refuse_idle(self, idle)


_NOT_CONFIGURATION: dict[str, Any] = {"out": None, "resume": None, "json": False, "yes": False}
_ABOUT = (
    "Learn an unknown whip, strike by strike, until it hits. "
    "Example: python -m whiptool.adapt --target 1.2 0.1 --port twin --camera points --family strange --seed 3"
)


def main(args: Sequence[str] | None = None) -> int:
    """The command line; the exit status is 0 after a hit, 1 without one, 2 for bad input, 130 when interrupted."""
    return cli.run(lambda: _adapt(list(sys.argv[1:] if args is None else args)))


def prepare(options: AdaptOptions, folder: Path | None = None) -> Adaptation:
    """The adaptation that options describe, ready to run.

    Args:
        options: See there; `out`, `resume` and `json` are not looked at.
        folder: Run folder; None: nothing is kept.

    Raises:
        InputError: An option breaks its rule.
    """
    from whiptool.adaptation.loop import Adaptation, Options
    from whiptool.adaptation.planner import FIRST, NEXT
    from whiptool.adaptation.prior import read_belief
    from whiptool.identification.recording import StrikeRecording
    from whiptool.rig.emulator.motor import HARDWARE, Motor
    from whiptool.rig.limits import limits_preset
    from whiptool.strike import StrikeBounds, default_bounds

    tip = options.port == "twin" and options.camera == "tip"
    stock, target = _stock(options), options.build_target()
    model = options.build_model() if stock is None else stock.owned(options.build_model())
    controller = _controller(options, model)
    target.check_reach(model)
    limits = options.limits or (None if tip else "xm430")
    usual = default_bounds(model.arm)
    slow = StrikeBounds((*usual.lower[:-1], SLOW), usual.upper)
    loop = Options(
        max_strikes=options.max_strikes,
        starts=options.starts,
        seed=options.seed,
        t_stay=options.t_stay,
        limits=None if limits is None else limits_preset(limits),
        speed=options.least_speed,
        bounds=usual if limits is None else slow,
        check=None if tip else lambda strike, believed: _refusal(options, model, controller, strike, believed),
        first=FIRST if limits is None else replace(FIRST, pool=1024),
        later=NEXT if limits is None else replace(NEXT, pool=512),
        still=options.still,
        wiggle=options.wiggle,
    )
    known = [StrikeRecording.load(path) for path in options.known]
    motor = None if tip else HARDWARE if options.friction else Motor()
    prior = read_belief(options.prior, model, controller, whip=options.whip, motor=motor, stock=stock)
    port = _port(options, model, controller, stock)
    _refuse_other_weights(known, prior.plant.controller)
    return Adaptation(prior, port, target, loop, folder, recordings=known)


def _adapt(words: list[str]) -> int:
    options = cli.parse_resumable(
        AdaptOptions, command="adapt", description=_ABOUT, args=words, not_configuration=_NOT_CONFIGURATION
    )
    adaptation = prepare(options)
    config = {"command": "adapt", "options": cli.as_plain(replace(options, **_NOT_CONFIGURATION))}
    with cli.open_folder(options, "adapt", config) as folder:
        adaptation.folder = folder.path
        steps: list[Step] = []
        adaptation.run(lambda step: _tell(steps, step, adaptation.prior))
        summary = _summary(steps)
        write_whole(folder.path / REPORT, _page(adaptation, steps, options))
        folder.write_result(summary)
        print(json.dumps(summary, allow_nan=False) if options.json else _conclusion(summary, folder.path))
        return 0 if summary["hit"] else 1


def _refuse_other_weights(recordings, controller) -> None:
    """Earlier strikes are learned from as if this controller had struck them."""
    from whiptool.identification.inputs import common_controller

    for recording in recordings:
        then = common_controller([recording])
        if then is not None and then.compensated not in (None, controller.compensated):
            raise InputError(
                f"--known {recording.source}: masses that gravity compensation reckoned with [kg]",
                then.compensated,
                f"{controller.compensated}, those of --model",
                "give the --model that it was struck with",
            )


def _stock(options: AdaptOptions):
    """What is known of the whip's numbers; None: they are about the model's."""
    from whiptool.adaptation.materials import stock_of_material

    if options.material is not None:
        return stock_of_material(options.material, diameter=options.diameter, length=options.length)
    for name in ("diameter", "length"):
        if getattr(options, name) is not None:
            raise InputError(f"--{name}", getattr(options, name), "only with --material", "or give --model or --prior")
    return None


def _controller(options: AdaptOptions, model):
    """The controller; a rig's holds the torque for a cycle, and compensates the weights that its owner knows of."""
    controller = options.build_controller()
    if options.camera == "tip":
        return controller
    return replace(controller, control_period=1 / options.rate).reckoning_with(model)


def _refusal(options: AdaptOptions, model, controller, strike, believed) -> str | None:
    """Why the loop would not strike so: its rehearsal, but without what an arm hardly feels and a step is slow with."""
    from whiptool.rig.loop import LoopOptions
    from whiptool.rig.rehearsal import rehearse

    smooth = replace(believed, whip=replace(believed.whip, drag=0.0, dry_friction=0.0))
    return rehearse(
        model,
        controller,
        strike,
        rate=options.rate,
        delay=options.latency,
        t_stay=options.t_stay,
        margin=LoopOptions.margin + UNFELT,
        believed=smooth,
    ).refused


def _port(options: AdaptOptions, model, controller, stock):
    """What strikes and films."""
    from whiptool.adaptation.ports import RigPort, TipPort
    from whiptool.adaptation.twins import draw_twin
    from whiptool.rig.command import hardware_rig, loop_options
    from whiptool.rig.emulator.motor import HARDWARE, Motor
    from whiptool.rig.session import TwinRig

    target = options.build_target().position
    if options.port != "twin":
        rig = hardware_rig(options, model, controller, loop_options(options))
        return RigPort(lambda number: rig, target)
    twin = draw_twin(options.family, options.seed, model, controller, stock)
    if options.camera == "tip":
        return TipPort(twin, target, t_stay=options.t_stay)
    camera = "d435-infrared" if options.camera == "twin" else options.camera
    loop = loop_options(options)

    def make(number: int) -> TwinRig:
        seed = 1000 * options.seed + number
        return TwinRig(
            model,
            twin.controller,
            truth=twin.truth(HARDWARE if options.friction else Motor()),
            camera=camera,
            target=target,
            options=loop,
            at_once=True,
            seed=seed,
        )

    return RigPort(make, target)


def _tell(steps: list[Step], step: Step, prior: Belief) -> None:
    """What came of a strike, as it comes."""
    from whiptool.adaptation.report import lines

    before = next((s.learned.belief for s in reversed(steps) if s.learned), None)
    print("\n".join(lines(step, prior, before)), file=sys.stderr)
    steps.append(step)


def _page(adaptation: Adaptation, steps: list[Step], options: AdaptOptions) -> str:
    """The report."""
    from whiptool.adaptation.report import sections
    from whiptool.report import to_html
    from whiptool.runs import code_version

    x, y = adaptation.target.position[:2]
    facts = {
        "code": f"whiptool {code_version()}",
        "believed": f"{options.model}, {options.controller_label()}; prior: {options.prior or options.whip}"
        + (f", {options.material}" if options.material else ""),
        "struck with": f"twin, family {options.family}, seed {options.seed}"
        if options.port == "twin"
        else options.port,
        "camera": options.camera,
        "target": f"({x:g}, {y:g}) m, hit radius {adaptation.target.hit_radius:g} m",
    }
    subtitle = "Strike, film, identify, plan again: what each strike taught of the whip."
    return to_html("An unknown whip", subtitle, facts, sections(steps, adaptation.prior, adaptation.target))


def _summary(steps) -> dict[str, Any]:
    strikes = [step for step in steps if step.number]
    misses = [None if step.judged is None else step.judged.miss for step in strikes]
    return {
        "hit": bool(strikes and strikes[-1].hit),
        "strikes": len(strikes),
        "miss_distance": [m if s.outcome.true_miss is None else s.outcome.true_miss for m, s in zip(misses, strikes)],
        "judged_miss": misses,
        "judged_error": [None if s.judged is None else s.judged.error for s in strikes],
        "hit_probability": [None if s.judged is None else s.judged.probability for s in strikes],
        "stated_probability": [s.plan.probability for s in strikes],
        "faults": [s.outcome.fault for s in strikes],
        "refused": strikes[-1].learned.refused if strikes and strikes[-1].learned else {},
        "values": strikes[-1].learned.belief.values() if strikes and strikes[-1].learned else {},
    }


def _conclusion(summary: dict[str, Any], folder: Path) -> str:
    from whiptool.adaptation.report import percent

    rows = zip(summary["judged_miss"], summary["judged_error"], summary["hit_probability"], strict=True)
    judged = ["unknown" if m is None else f"{100 * m:.2f} ± {100 * e:.2f} ({percent(p)})" for m, e, p in rows]
    said = "hit claimed at" if summary["hit"] else "no hit claimed up to"
    misses = f"misses as judged, with standard error and probability of a hit [cm]: {', '.join(judged)}"
    return f"{said} strike {summary['strikes']}; {misses}; run folder {folder}"


if __name__ == "__main__":
    sys.exit(main())
