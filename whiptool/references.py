"""What to cite: BibTeX entries of the models, control laws and methods that were used."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

from whiptool.errors import InputError
from whiptool.words import method_name

CITATIONS = "citations.bib"  # in a run folder
ALWAYS = ("wang2024", "todorov2012", "andersson2019", "carpentier2019")  # the framework and the two simulators
WORKS: dict[str, tuple[str, ...]] = {  # keys of the entries in references.bib by what they are the source of
    "lemon2024": (),
    **dict.fromkeys(("nah2020", "nah2020-n10", "nah2020-n15", "nah2020-n20", "nah2020-fitted"), ("nah2020",)),
    "nah2023": ("nah2023",),
    "ur5e": ("menagerie2022",),
    "panda": (),
    "oiac": ("xiong2021",),
    "constant": ("hogan1985",),
    "position": (),
    "directl": ("gablonsky2001", "johnson2007"),
    "gradient": ("kraft1988", "johnson2007"),
    "nlopt": ("johnson2007",),
    "map": (),
    "pareto": ("haimes1971", "kraft1988", "johnson2007"),
    "cmaes": ("hansen2001", "blank2020"),
    "ga": ("blank2020",),
    "sac": ("haarnoja2018",),
    "td3": ("fujimoto2018",),
    "ddpg": ("lillicrap2016",),
    "ppo": ("schulman2017",),
    "random": (),
    "human": ("krotov2022",),
}


def citations(*names: str) -> str:
    """Return the BibTeX entries of the works to cite, for a bibliography.

    Args:
        names: Names of the used parts: presets (`ur5e`), control laws (`oiac`), search methods and learners (`cmaes`,
            `nlopt:GN_CRS2_LM`), `pareto`, or `human` for the data of Krotov et al. 2022. The works on the framework and
            on the simulators are always included.

    Raises:
        InputError: A name is unknown; the message lists the names.
    """
    keys = list(ALWAYS)
    for name in names:
        own = _own(name)
        if own not in WORKS:
            raise InputError("name", name, ", ".join(WORKS))
        keys += WORKS[own]
    entries = _entries()
    return "\n\n".join(entries[key] for key in dict.fromkeys(keys)) + "\n"


def used_by(config: Mapping, result: Mapping) -> Iterator[str]:
    """Yield, from a run's configuration and result, the names of its parts that should be cited."""
    options = config.get("options", {})
    law, model = config.get("controller", {}).get("law"), config.get("model", {}).get("name")
    methods = (options.get("method"), result.get("method"), *options.get("methods", []))
    for name in (config.get("command"), model, options.get("arm"), law, *methods):
        if isinstance(name, str) and _own(name) in WORKS:
            yield name


def _own(name: str) -> str:
    return "nlopt" if name.startswith("nlopt:") else name if name in WORKS else method_name(name)


def _entries() -> dict[str, str]:
    """Return the entries of `references.bib` by key."""
    texts = (Path(__file__).parent / "references.bib").read_text(encoding="utf-8").strip().split("\n\n")
    return {text[text.index("{") + 1 : text.index(",")]: text for text in texts}
