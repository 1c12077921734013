"""Options of a whip that is like the model's, but longer, of other nodes, tapered, or of another material."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

from whiptool.errors import NOTHING, InputError
from whiptool.options.base import OptionGroup, flag

if TYPE_CHECKING:
    from whiptool.models.parameters import Model

_MATERIAL = ("youngs_modulus", "diameter", "density")
_FLAGS = {"length": "--whip-length", "nodes": "--nodes", "taper": "--taper"} | {x: flag(x) for x in _MATERIAL}


@dataclass(frozen=True, kw_only=True)
class WhipOptions(OptionGroup):
    """The model's whip, changed."""

    heading: ClassVar[str] = "model"
    first: ClassVar[tuple[str, ...]] = ("whip_length", "nodes")

    whip_length: float | None = None
    """Length of the whip [m], of the same material; default: the model's."""
    nodes: int | None = None
    """Nodes that the whip is lumped into; default: the model's."""
    taper: float | None = None
    """Thickness of the whip at its tip over that at its handle; default: the model's."""
    youngs_modulus: float | None = None
    """Of a round whip of one material in place of the model's: Young's modulus [Pa]. With --diameter and --density; its
    damping keeps the model's ratio to its stiffness."""
    diameter: float | None = None
    """Likewise, its diameter [m]."""
    density: float | None = None
    """Likewise, its mass per volume [kg/m^3]."""

    def changed_whip(self, model: Model) -> Model:
        """Return a model with the whip that the options describe.

        Raises:
            InputError: A number is out of range, the material is not whole, or the model's whip cannot be changed so.
        """
        material = {name: getattr(self, name) for name in _MATERIAL}
        missing = [flag(name) for name, value in material.items() if value is None]
        if 0 < len(missing) < len(material):
            raise InputError(missing[0], NOTHING, f"a value: {', '.join(map(flag, _MATERIAL))} go together")
        changes = {"length": self.whip_length, "nodes": self.number_of_nodes, "taper": self.taper}
        try:
            if not missing:
                from whiptool.models.material import of_material

                model = replace(model, whip=of_material(model.whip, **material))
            return model if set(changes.values()) == {None} else model.with_whip(**changes)
        except InputError as error:
            raise error.renamed(_FLAGS.get(error.name, error.name)) from None

    @property
    def number_of_nodes(self) -> int | None:
        """The number of nodes that is asked for; None: the model's."""
        return self.nodes
