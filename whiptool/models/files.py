"""Models as TOML files: read with every mistake named, written so that they read back the same."""

from __future__ import annotations

import dataclasses
import tomllib
from collections.abc import Mapping
from pathlib import Path

import tomli_w

from whiptool.errors import InputError
from whiptool.models.parameters import ArmLink, ArmParameters, Model, WhipParameters
from whiptool.models.presets import PRESETS, preset
from whiptool.models.profile import WhipProfile
from whiptool.whole_files import write_whole


def _build(cls: type, table: object, place: str, **ready):
    """`cls(**table)`, unknown or missing keys and broken rules named with their place."""
    if not isinstance(table, Mapping):
        raise InputError(place.rstrip("."), table, "a table")
    names = {f.name: f for f in dataclasses.fields(cls)}
    for key in table:
        if key not in names:
            raise InputError(place + key, table[key], "one of the keys " + ", ".join(names))
    for name, f in names.items():
        required = f.default is dataclasses.MISSING and f.default_factory is dataclasses.MISSING
        if required and name not in table and name not in ready:
            raise InputError(place + name, None, f"a value; the key is missing, all keys are {', '.join(names)}")
    try:
        return cls(**{**table, **ready})
    except InputError as error:
        raise error.within(place) from None


def model_from_table(table: Mapping) -> Model:
    """A model from nested mappings, as TOML gives them; `whip.profile` and `whip.N` describe a profile to lump.

    Raises:
        InputError: A key is unknown or missing, or a value breaks its rule; the key is named.
    """
    table = dict(table)
    whip = table.get("whip", {})
    if isinstance(whip, Mapping) and "profile" in whip:
        for key in whip:
            if key not in ("profile", "N"):
                raise InputError(f"whip.{key}", whip[key], "only profile and N, where a profile is given")
        profile = _build(WhipProfile, whip["profile"], "whip.profile.")
        try:
            table["whip"] = profile.lump(whip.get("N"))  # type: ignore[arg-type]
        except InputError as error:
            raise error.within("whip.") from None
    elif "whip" in table:
        table["whip"] = _build(WhipParameters, whip, "whip.")
    if "arm" in table:
        arm = dict(table["arm"]) if isinstance(table["arm"], Mapping) else table["arm"]
        if isinstance(arm, dict) and isinstance(arm.get("links"), list):
            arm["links"] = tuple(_build(ArmLink, link, f"arm.links[{i}].") for i, link in enumerate(arm["links"]))
        table["arm"] = _build(ArmParameters, arm, "arm.")
    return _build(Model, table, "")


def model_to_table(model: Model) -> dict:
    """The model as nested plain data; `model_from_table` gives the same model back."""
    arm = {"joints": list(model.arm.joints), "links": [dataclasses.asdict(link) for link in model.arm.links]}
    whip = {k: list(v) if isinstance(v, tuple) else v for k, v in dataclasses.asdict(model.whip).items()}
    return {"name": model.name, "gravity": model.gravity, "whip": whip, "arm": arm}


def read_toml(path: Path) -> dict:
    """A TOML file as nested mappings.

    Raises:
        InputError: The file cannot be read, or is not TOML.
    """
    try:
        return tomllib.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError("file", str(path), f"a readable TOML file ({error.strerror})") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError("file", str(path), f"valid TOML ({error})") from None


def read_model(path: Path) -> Model:
    """A model from a TOML file.

    Raises:
        InputError: The file cannot be read, or says something that is not allowed.
    """
    table = read_toml(path)
    try:
        return model_from_table({"name": Path(path).stem, **table})
    except InputError as error:
        raise error.within(f"{path}: ") from None


def write_model(model: Model, path: Path) -> None:
    """Write a model as a TOML file that `read_model` reads back the same."""
    write_whole(Path(path), tomli_w.dumps(model_to_table(model)))


def find_model(name: str) -> Model:
    """A preset by its name, or a model from the TOML file of that path.

    Raises:
        InputError: There is neither.
    """
    if name in PRESETS:
        return preset(name)
    if name.endswith(".toml"):
        return read_model(Path(name))
    raise InputError("model", name, "a preset (" + ", ".join(PRESETS) + ") or the path of a .toml file")
