"""Published models by name."""

from __future__ import annotations

import dataclasses

from whiptool.errors import expect
from whiptool.extras import Registry
from whiptool.models.parameters import ArmLink, ArmParameters, Model, WhipParameters
from whiptool.models.robots import NAH2023, PANDA, UR5E

# Wang et al. 2024, Tables 2 and 3. Table 3 gives no inertias: uniform rods.
_LEMON = Model(
    name="lemon2024",
    whip=WhipParameters(N=12, l=0.072, m=0.012, k=0.242, b=0.092),
    arm=ArmParameters((ArmLink(mass=0.25, length=0.31), ArmLink(mass=0.274, length=0.34))),
)
# Nah et al. 2020 (BioRob, 685-691): a human arm with three generic whips and one fitted to an experiment.
_NAH_ARM = ArmParameters(
    (
        ArmLink(mass=1.595, length=0.294, com=0.129, inertia=0.011937),
        ArmLink(mass=0.869, length=0.291, com=0.112, inertia=0.004855),
    )
)


def _nah(name: str, whip: WhipParameters) -> Model:
    return Model(name=name, whip=whip, arm=_NAH_ARM)


PRESETS: Registry[Model] = Registry(
    "presets",
    Model,
    {
        model.name: model
        for model in (
            _LEMON,
            *(_nah(f"nah2020-n{N}", WhipParameters(N=N, l=0.1, m=0.1, k=0.05, b=0.005)) for N in (10, 15, 20)),
            _nah("nah2020-fitted", WhipParameters(N=25, l=0.072, m=0.012, k=0.242, b=0.092)),
            NAH2023,
            UR5E,
            PANDA,
        )
    },
    what="model preset",
)


def presets() -> list[str]:
    """Return the names of the published models, including those of installed packages; see `preset`."""
    PRESETS.add_installed()
    return list(PRESETS)


def preset(name: str) -> Model:
    """Return the published model called `name`, in capital or small letters.

    Raises:
        InputError: No preset has that name; the message lists the presets.
    """
    expect(str, name=name)
    return dataclasses.replace(PRESETS.find(name))
