"""Options of the model: arm, mount, and changes of the whip's length, number of nodes, taper or material."""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, ClassVar

from whiptool.commands.options.option_group import Names, OptionGroup, flag
from whiptool.errors import NOTHING, InputError
from whiptool.given_files import number_in

if TYPE_CHECKING:
    from whiptool.models.parameters import Model
    from whiptool.models.visuals import Look

_MATERIAL = ("youngs_modulus", "diameter", "density")
_FLAGS = {"length": "--whip-length", "nodes": "--nodes", "taper": "--taper"} | {x: flag(x) for x in _MATERIAL}


@dataclass(frozen=True, kw_only=True)
class WhipOptions(OptionGroup):
    """Options that change the model's whip: length, nodes, taper and material."""

    heading: ClassVar[str] = "model"
    first: ClassVar[tuple[str, ...]] = ("whip_length",)

    whip_length: float | None = None
    """Length of the whip [m] (default: that of --model). The material stays the same."""
    nodes: int | None = None
    """Number of nodes of the whip (default: that of --model)."""
    taper: float | None = None
    """Thickness of the whip at its tip divided by that at its handle (default: that of --model)."""
    youngs_modulus: float | None = None
    """Young's modulus [Pa] of a uniform round whip that replaces the whip of --model; requires --diameter and
    --density. The ratio of damping to stiffness is kept."""
    diameter: float | None = None
    """Diameter of the whip that --youngs-modulus describes [m]."""
    density: float | None = None
    """Density of the whip that --youngs-modulus describes [kg/m^3]."""

    def changed_whip(self, model: Model) -> Model:
        """Return the model with its whip changed by the options.

        Raises:
            InputError: A number is out of range, the material is incomplete, or the model's whip cannot be changed in
                this way.
        """
        material = self.material_of_model
        missing = [flag(name) for name in _MATERIAL if name not in material]
        if material and missing:
            raise InputError(missing[0], NOTHING, f"a value: {', '.join(map(flag, _MATERIAL))} go together")
        changes = {"length": self.whip_length, "nodes": self.number_of_nodes, "taper": self.taper}
        try:
            if material:
                from whiptool.models.profile import of_material

                model = replace(model, whip=of_material(model.whip, **material))
            return model if set(changes.values()) == {None} else model.with_whip(**changes)
        except InputError as error:
            raise error.renamed(_FLAGS.get(error.name, error.name)) from None

    @property
    def material_of_model(self) -> dict[str, float]:
        """Parameters, by name, of the given material, which replaces the material of the model's whip."""
        return {name: getattr(self, name) for name in _MATERIAL if getattr(self, name) is not None}

    @property
    def number_of_nodes(self) -> int | None:
        """The number of nodes that the options set; None: the model's."""
        return self.nodes


ModelName = Annotated[str, Names("whiptool.models.presets:PRESETS", beside="|FILE.toml|FILE.urdf|FILE.xml")]


@dataclass(frozen=True, kw_only=True)
class ModelOptions(WhipOptions):
    """Options for the model of whip and arm."""

    heading: ClassVar[str] = "model"
    first: ClassVar[tuple[str, ...]] = (
        "model",
        "arm",
    )
    in_space: ClassVar[bool] = False  # whether the command takes models in space

    model: ModelName = "lemon2024"
    """Model of arm and whip: a preset or a file. The presets nah2023, ur5e and panda are in space. A robot in URDF or
    MJCF gets the rope of ur5e."""

    arm: str | None = None
    """Use the arm of this preset or file with the whip of --model. The file can be a robot's URDF. If only one of the
    two models is in space, the arm keeps its own whip."""

    arm_tip: str | None = None
    """Link, body or site of the robot's file to which the whip is attached; needed if the robot's chain branches.
    Default: the last link."""

    mount: tuple[str, ...] = ("floor",)
    """Mounting of the base of an arm in space: floor (or table); pedestal, wall (its z axis points forward) or ceiling,
    with the height of the base above the floor [m], such as pedestal 0.8; or its roll, pitch and yaw [rad]. Strikes
    keep clear of pedestal, wall, ceiling and floor."""

    def build_model(self) -> Model:
        """Return the model of `--model` with the arm of `--arm`; assumptions about the arm are printed on stderr.

        Raises:
            InputError: No model has that name, the arm does not fit the whip, or the command takes no models in space.
        """
        model = self.find_model()
        for note in model.arm.notes:
            print(f"whiptool: {self.arm or self.model}: {note}", file=sys.stderr)
        return model

    def find_model(self) -> Model:
        """Return the model as `build_model` does, without printing; files are read only once."""
        return self._model_found

    def find_looks(self) -> list[Look] | None:
        """Return what the robot looks like, see `whiptool.models.files.robot_looks`; None: like its model's shapes.

        Raises:
            InputError: The robot's file, or a mesh in it, cannot be read.
        """
        from whiptool.models.files import robot_looks

        model = self.find_model()
        name = self.model if self.arm is None else self.arm
        return robot_looks(name, model.arm, tip=self.arm_tip or "") if model.dimension == 3 else None

    @cached_property
    def _model_found(self) -> Model:
        of_model, of_arm = (self.arm_tip or "", "") if self.arm is None else ("", self.arm_tip or "")
        model = _loaded("--model", self.model, of_model)
        if self.arm is not None:
            other = _loaded("--arm", self.arm, of_arm)
            model = replace(other, whip=model.whip) if other.dimension == model.dimension else other
        if model.dimension == 3 and not self.in_space:
            option, given = ("--model", self.model) if self.arm is None else ("--arm", self.arm)
            raise InputError(option, given, "a model in the plane, for this command")
        return self._mounted(self.changed_whip(model))

    def _mounted(self, model: Model) -> Model:
        """The model with its base as `--mount` says."""
        from whiptool.models.mount import MOUNT_RULE, MOUNTS, mounted

        if self.mount == ("floor",):
            return model
        if model.dimension == 2:
            raise InputError("--mount", self.mount, "only floor, for an arm in the plane")
        name, *height = self.mount
        named = name in MOUNTS and len(height) <= 1
        try:
            given = name if named else [number_in(x) for x in self.mount]
            above = number_in(height[0]) if named and height else None
            return replace(model, arm=mounted(model.arm.in_space(), given, above))
        except InputError as error:
            raise error.renamed("--mount") from None
        except ValueError:
            raise InputError("--mount", " ".join(self.mount), MOUNT_RULE) from None


def _loaded(option: str, name: str, tip: str) -> Model:
    """Return the model that an option names; an error of it that names no option names this one."""
    from whiptool.models.files import load_model

    try:
        return load_model(name, tip=tip)
    except InputError as error:
        raise error.renamed(option) if error.name in ("model", "file") else error from None
