"""Options of an adaptation, and the adaptation that they describe."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

from tyro.conf import arg

from whiptool.commands.options.option_group import Condition, Conditions, Names, ResumableOptions, unless, when, whole
from whiptool.commands.options.rig_options import ArmOptions, hardware_rig, loop_options
from whiptool.commands.options.target_options import GoalOptions
from whiptool.errors import InputError

if TYPE_CHECKING:
    from whiptool.adaptation.loop import Adaptation
    from whiptool.goals.target import Target
    from whiptool.impedance import Controller
    from whiptool.models import Model
    from whiptool.rig.stops import Interlock

CAMERAS = ("tip", "points", "twin", "d435-color", "d435-infrared")
SLOW = 0.9  # [s], shortest movement within a motor's limits
UNFELT = 0.01  # part of a motor's line that is left for the drag and dry friction that a check leaves out
FASTEST_TIP = 343.0  # [m/s], of sound: where a whip cracks
ROBOT = "robot"  # a port
_OF_RIGS = unless("port", ROBOT, why=", where your own program commands and records")
_NOT_AT_REST = Condition(
    "only with a real arm: the twin is already at the start of its strike", lambda o: o.port != "twin"
)
_SERVOS = Condition("only without --camera tip, which has no servos", lambda o: o.port != "twin" or o.camera != "tip")
_IN_SPACE = Condition("only for a model in space", lambda o: o.find_model().dimension == 3)


@dataclass(frozen=True, kw_only=True)
class AdaptOptions(ResumableOptions, GoalOptions, ArmOptions):
    """Options of `adapt`, which strikes, films, identifies the whip and plans again until an unknown whip hits."""

    first: ClassVar[tuple[str, ...]] = ("port", "camera", "family", "material")
    in_space: ClassVar[bool] = True
    only_with: ClassVar[Conditions] = {
        **dict.fromkeys(("camera", "yes", "limits"), (_OF_RIGS,)),
        **dict.fromkeys(("approach_speed", "settle"), (_OF_RIGS, _NOT_AT_REST)),
        **dict.fromkeys(("rate", "friction", "latency"), (_OF_RIGS, _SERVOS)),
        "family": (when("port", "twin"),),
        **dict.fromkeys(("direction", "arrival_angle"), (_IN_SPACE,)),
    }

    port: str = "twin"
    """Serial device, twin (simulated rig) or robot. A device is, for example, /dev/ttyUSB0; twin emulates the servos
    and their protocol; robot is your position-controlled robot. A robot takes each strike as a trajectory from the run
    folder; put its recording there as recorded.csv and use --resume."""
    camera: Annotated[str, arg(metavar="{tip,points,twin,d435-color,d435-infrared,realsense}|FILE.db3")] = "points"
    """Camera (tip and points: positions without images). With the twin: points (the tip with the error of tracked
    images), twin or d435-infrared (rendered infrared images), d435-color (colour images), or tip (60 frames a second, 5
    mm noise, no servos). With a real arm: realsense, or a RealSense recording."""
    family: Annotated[str, Names("whiptool.adaptation.twins:FAMILIES")] = "strange"
    """Deviation of the simulated whip from --model. kin: a uniform whip near the model; strange: tapered, with a bead,
    a soft joint and more; stranger: the same deviations, doubled."""
    material: Annotated[str, Names("whiptool.adaptation.materials:MATERIALS")] | None = None
    """Known material of the whip, for the prior mean. Without it the prior mean is --model. The prior covariance is
    that of materials in general."""
    diameter: float | None = None
    """Measured diameter of a whip of --material [m], of a chain that of its wire; or the diameter that belongs to
    --youngs-modulus."""
    length: float | None = None
    """Measured length of a whip of --material [m]."""
    max_strikes: int = 6
    """Largest number of strikes. Measurements before the first strike do not count."""
    whip: Annotated[str, Names("whiptool.adaptation.prior:WHIPS")] = "profile"
    """Parametrisation of the whip that is identified: profile (tapers, drag, friction, rest curvature) or uniform (k,
    b, m, l)."""
    prior: str | None = None
    """TOML file that replaces the default prior of the parameters that it names, with lines such as "profile.length" =
    {value = 0.9, error = 0.05}."""
    known: tuple[str, ...] = ()
    """Recordings of earlier strikes with the same whip, which contain the tip and the commanded strike."""
    limits: Annotated[str, Names("whiptool.limits.arm_limits:LIMITS")] | None = None
    """Motor whose limits strikes have to keep; default: xm430, but none for --camera tip, which has no motors."""
    still: bool = True
    """Film the hanging whip before the first strike, to measure its length. Not needed with --wiggle or --known."""
    wiggle: bool = False
    """Begin with a short, slow movement that is planned for its information gain about the whip."""
    starts: int = 3
    """Number of starting points of every fit."""
    seed: int = 0
    """Seed of the twin's whip and all other random numbers (default: 0)."""

    @property
    def material_of_model(self) -> dict[str, float]:
        """Material parameters that the options give to the model's whip, by name; with --material without
        `diameter`."""
        given = super().material_of_model
        return {name: x for name, x in given.items() if self.material is None or name != "diameter"}

    def check(self) -> None:
        """Refuse values that are out of range, and options that contradict each other."""
        from whiptool.models.files import load_model
        from whiptool.models.numbers import number

        super().check()
        self._check_space(load_model(self.model))
        if self.port == "twin" and self.camera not in CAMERAS:
            raise InputError("--camera", self.camera, ", ".join(CAMERAS) + " with --port twin")
        if self.port not in ("twin", ROBOT) and self.camera != "realsense" and not self.camera.endswith(".db3"):
            raise InputError("--camera", self.camera, "realsense or a .db3 recording, with a real arm")
        if self.wiggle and not self.still:
            raise InputError(
                "--no-still",
                "together with --wiggle",
                "one of them",
                "--wiggle also measures the whip before the first strike",
            )
        _stock(self)
        if self.least_speed is not None:
            number("--least-speed", self.least_speed, low=0, high=FASTEST_TIP)
        whole("--max-strikes", self.max_strikes)
        whole("--starts", self.starts, high=1000)

    def needs(self) -> tuple[str, ...]:
        """Return the modules of extras that the command imports with these options."""
        return () if self.camera == "tip" or self.port == ROBOT else super().needs()

    def _check_space(self, model: Model) -> None:
        """Refuse servos and images of an arm in space, and directions in the plane."""
        if model.dimension == 3 and self.port != ROBOT and (self.port, self.camera) != ("twin", "tip"):
            raise InputError(
                "--model", self.model, "a model in the plane, unless --port robot or --camera tip is given"
            )

    def build_target(self, model: Model | None = None) -> Target:
        """Return the target with direction and speed of arrival; a least speed of 0 requires no speed."""
        return GoalOptions.build_target(replace(self, least_speed=self.least_speed or None), model)

    def build_controller(self) -> Controller:
        """Return the controller that the options describe; for an arm in space or a robot, position control."""
        from whiptool.models.files import load_model

        if self.port != ROBOT and load_model(self.model).dimension == 2:
            return super().build_controller()
        from whiptool.impedance import Controller, PositionControl

        return Controller(PositionControl())


def prepare(options: AdaptOptions, folder: Path | None = None) -> Adaptation:
    """Return the adaptation that the options describe, ready to run.

    Args:
        options: Options of the command; `out`, `resume` and `json` are ignored.
        folder: Run folder; None: nothing is kept.

    Raises:
        InputError: An option is out of range.
    """
    from whiptool.adaptation.adapter import Options
    from whiptool.adaptation.loop import Adaptation
    from whiptool.adaptation.prior import read_belief
    from whiptool.limits.all_limits import default_limits
    from whiptool.limits.arm_limits import limits_preset
    from whiptool.models.strike import StrikeBounds, default_bounds
    from whiptool.recording.readers import read_recording
    from whiptool.rig.emulator.motor import HARDWARE, Motor
    from whiptool.rig.stops import Interlock

    tip = (options.port == "twin" and options.camera == "tip") or options.port == ROBOT  # no motors of ours
    stock = _stock(options)
    model = options.build_model() if stock is None else stock.owned(options.build_model())
    target = options.build_target(model)
    controller = _controller(options, model)
    target.check_reach(model)
    motor = options.limits or (None if tip else "xm430")
    motors = () if motor is None else (limits_preset(motor),)
    usual = default_bounds(model.arm)
    slow = StrikeBounds((*usual.lower[:-1], SLOW), usual.upper)
    loop = Options(
        max_strikes=options.max_strikes,
        starts=options.starts,
        seed=options.seed,
        t_stay=options.t_stay,
        limits=(*motors, *default_limits(model, prescribed=True)),
        bounds=slow if motors else usual,
        check=None if tip else lambda strike, believed: _refusal(options, model, controller, strike, believed),
        still=options.still,
        wiggle=options.wiggle,
        **_efforts(model, limited=bool(motors)),
    )
    known = [read_recording(path).for_model(model) for path in options.known]
    drive = None if tip else HARDWARE if options.friction else Motor()
    prior = read_belief(options.prior, model, controller, whip=options.whip, motor=drive, stock=stock)
    interlock = Interlock()
    port = _port(options, model, controller, stock, interlock)
    _check_known(known, prior.plant.controller)
    return Adaptation(prior, port, target, loop, folder, recordings=known, interlock=interlock)


def _efforts(model: Model, *, limited: bool) -> dict[str, Any]:
    """How hard strikes are looked for: harder within the motors' limits, hardest where they are aimed in space."""
    from whiptool.adaptation.planner import FIRST, FIRST_IN_SPACE, NEXT, NEXT_IN_SPACE, RETRIES_IN_SPACE

    if model.dimension == 3:
        return {"first": FIRST_IN_SPACE, "later": NEXT_IN_SPACE, "retries": RETRIES_IN_SPACE}
    if limited:
        return {"first": replace(FIRST, pool=1024), "later": replace(NEXT, pool=512)}
    return {"first": FIRST, "later": NEXT}


def _check_known(recordings, controller) -> None:
    """Earlier strikes are learned from as if this controller had struck them."""
    from whiptool.identification.inputs import check_controllers

    try:
        check_controllers(recordings, controller)
    except InputError as error:
        fix = "give the --model and --controller that it was struck with"
        raise InputError(f"--known {error.name}", error.given, error.allowed, fix) from None


def _stock(options: AdaptOptions):
    """The whips that the given material allows; None: no material was given, and the model's whip is the centre."""
    from whiptool.adaptation.materials import stock_of_material

    if options.material is not None:
        return stock_of_material(options.material, diameter=options.diameter, length=options.length)
    for name in ("diameter", "length"):
        if getattr(options, name) is not None and (name == "length" or options.youngs_modulus is None):
            raise InputError(f"--{name}", getattr(options, name), "only with --material", "or give --model or --prior")
    return None


def _controller(options: AdaptOptions, model):
    """The controller; a rig's holds the torque for a cycle, and compensates the weights that it is given."""
    controller = options.build_controller()
    if options.camera == "tip" or options.port == ROBOT:
        return controller
    return replace(controller, control_period=1 / options.rate).reckoning_with(model)


def _refusal(options: AdaptOptions, model, controller, strike, believed) -> str | None:
    """Return why the control loop would refuse a strike, None if it would not.

    The rehearsal leaves out drag and dry friction of the whip, which an arm hardly feels and which take small steps.
    """
    from whiptool.rig.rehearsal import rehearse

    smooth = replace(believed, whip=replace(believed.whip, drag=0.0, dry_friction=0.0))
    loop = loop_options(options)
    kept_free = replace(loop, margin=loop.margin + UNFELT)
    return rehearse(model, controller, strike, kept_free, believed=smooth).refused


def _port(options: AdaptOptions, model, controller, stock, interlock: Interlock):
    """The port: a twin at the tip, a twin of the whole rig, or the rig."""
    from whiptool.adaptation.ports import RigPort, RobotPort, TipPort, truth_of
    from whiptool.adaptation.twins import draw_twin
    from whiptool.rig.emulator.motor import HARDWARE, Motor
    from whiptool.rig.session import TwinRig

    goal = options.build_target(model)
    target = goal.position
    if options.port == ROBOT:
        return RobotPort(model, goal, t_stay=options.t_stay)
    if options.port != "twin":
        rig = hardware_rig(options, model, controller, loop_options(options), interlock)
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
            truth=replace(truth_of(twin, HARDWARE if options.friction else Motor()), seed=seed),
            camera=camera,
            target=target,
            options=loop,
            at_once=True,
            interlock=interlock,
        )

    return RigPort(make, target)
