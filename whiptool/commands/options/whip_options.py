"""Options that change the model's whip: length, number of nodes, taper or material."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

from whiptool.commands.options.option_group import OptionGroup, flag
from whiptool.errors import NOTHING, InputError

if TYPE_CHECKING:
    from whiptool.models.parameters import Model

_MATERIAL = ("youngs_modulus", "diameter", "density")
_FLAGS = {"length": "--whip-length", "nodes": "--nodes", "taper": "--taper"} | {x: flag(x) for x in _MATERIAL}


@dataclass(frozen=True, kw_only=True)
class WhipOptions(OptionGroup):
    """Options that change the model's whip: length, nodes, taper and material."""

    heading: ClassVar[str] = "model"
    first: ClassVar[tuple[str, ...]] = ("whip_length", "nodes")

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
        """The given parameters of the material that replaces that of the model's whip, by name."""
        return {name: getattr(self, name) for name in _MATERIAL if getattr(self, name) is not None}

    @property
    def number_of_nodes(self) -> int | None:
        """The number of nodes that the options set; None: the model's."""
        return self.nodes
