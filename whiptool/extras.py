"""Other packages: optional packages, which extras install, and additions of installed packages by entry points.

A missing package is reported with the command that installs it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from importlib import import_module
from importlib.metadata import entry_points
from importlib.util import find_spec
from types import MappingProxyType
from typing import Any, TypeVar

from whiptool.errors import InputError
from whiptool.words import as_named

T = TypeVar("T")

# of each extra: modules, and the packages that hold them
EXTRAS = {
    "rl": {"torch": "torch", "gymnasium": "gymnasium", "tensorboard": "tensorboard"},
    "vision": {"cv2": "opencv-python-headless"},
    "rig": {"dynamixel_sdk": "dynamixel-sdk", "pyrealsense2": "pyrealsense2"},
    "ur": {"rtde_control": "ur-rtde", "rtde_receive": "ur-rtde", "dashboard_client": "ur-rtde"},
    "franka": {"pylibfranka": "pylibfranka"},
    "io": {"pyarrow": "pyarrow", "rosbags": "rosbags", "ezc3d": "ezc3d", "mcap": "mcap", "h5py": "h5py"},
    "cluster": {"ray": "ray"},
    "oracle": {"elastica": "pyelastica", "numba": "numba"},
    "human": {"h5py": "h5py", "statsmodels": "statsmodels"},
    "studio": {"viser": "viser"},
}


class MissingPackage(InputError):
    """A package that is needed is not installed, or cannot be imported.

    Args:
        purpose: Feature that needs the package, such as `whiptool train`.
        state: A sentence about the package, such as `the package torch is not installed`.
        fix: Command that installs it.
    """

    def __init__(self, purpose: str, state: str, fix: str) -> None:
        super().__init__(purpose, state, "installed packages", fix)
        self.args = (f"{purpose}: {state}; install with: {fix}",)

    def renamed(self, name: str, fix: str = "") -> InputError:
        """Return the error unchanged: its name is the feature that needs the package, and not an option."""
        return self


def require(purpose: str, modules: Iterable[str]) -> None:
    """Check that modules are installed, without importing them.

    Args:
        purpose: Feature that needs them, such as `whiptool train`.
        modules: Top-level modules of extras.

    Raises:
        MissingPackage: A module is not installed; the message names all of them, and the command that installs them.
    """
    missing = [module for module in dict.fromkeys(modules) if find_spec(module) is None]
    if missing:
        raise _not_installed(purpose, missing)


def optional(module: str, purpose: str = "") -> Any:
    """Import and return a module that an optional dependency (extra) installs.

    Args:
        module: Name of the module, such as `pyarrow.parquet`.
        purpose: Feature that needs the module; default: the module.

    Raises:
        MissingPackage: The module is not installed, or cannot be imported.
    """
    try:
        return import_module(module)
    except ImportError as error:
        package = module.partition(".")[0]
        if find_spec(package) is None:
            wanted = package if any(package in packages for packages in EXTRAS.values()) else module
            raise _not_installed(purpose or wanted, [wanted]) from None
        state = f"the package {module} is installed but cannot be imported ({error})"
        raise MissingPackage(purpose or package, state, _command([package])) from error


class Registry(dict[str, T]):
    """Objects that users choose by name: those of whiptool, and those that installed packages add by entry points.

    Packages are only loaded when a name is looked up that whiptool does not have.

    Args:
        group: Packages register objects as entry points of `whiptool.<group>`.
        kind: Type of the objects.
        known: The objects of whiptool by name.
        what: Word for a name in error messages; default: the group.
        spelled: Function that returns the known name for a name as written.
    """

    def __init__(
        self,
        group: str,
        kind: Any,
        known: Mapping[str, T] = MappingProxyType({}),
        *,
        what: str = "",
        spelled: Callable[[str, Iterable[str]], str] = as_named,
    ) -> None:
        super().__init__(known)
        self.group, self.kind, self.what, self.spelled = group, kind, what or group, spelled

    def find(self, name: str) -> T:
        """Return the object called `name`, in any spelling.

        Raises:
            InputError: The name is unknown (the message lists the names), or an object of a package cannot be added.
        """
        return self[self.name(name)]

    def name(self, written: str) -> str:
        """Return the registered name for one in any spelling; errors as for `find`."""
        if not isinstance(written, str):
            raise InputError(self.what, written, ", ".join(self))
        own = self.spelled(written, self)
        if own not in self:
            self.add_installed()
            own = self.spelled(written, self)
        if own not in self:
            raise InputError(self.what, written, ", ".join(self))
        return own

    def add_installed(self) -> None:
        """Add the objects that installed packages register; the names of whiptool are kept.

        Raises:
            InputError: An object cannot be imported, is of another type, or has the name of another object.
        """
        for point in entry_points(group=f"whiptool.{self.group}"):
            name = f"entry point {point.name} of whiptool.{self.group}"
            try:
                found = point.load()
            except Exception as error:
                raise InputError(name, point.value, "an object that can be imported", f"reason: {error!r}") from error
            if not isinstance(found, self.kind):
                raise InputError(name, point.value, f"an object of type {self.kind.__name__}")
            if self.setdefault(point.name, found) is not found:
                raise InputError(
                    name, f"the name {point.name}", "a name that no other object has", f"rename {point.value}"
                )


def _not_installed(purpose: str, modules: list[str]) -> MissingPackage:
    packages = ", ".join(_package(module) for module in modules)
    state = f"packages {packages} are not installed" if len(modules) > 1 else f"the package {packages} is not installed"
    return MissingPackage(purpose, state, _command(modules))


def _package(module: str) -> str:
    """Return the package that holds a module."""
    return next((packages[module] for packages in EXTRAS.values() if module in packages), module)


def extras_with(modules: Iterable[str]) -> list[str]:
    """Return the extras that install some modules; one that several extras install adds none to the others'."""
    holding = {module: [extra for extra, packages in EXTRAS.items() if module in packages] for module in modules}
    chosen = set[str]()
    for extras in sorted(filter(None, holding.values()), key=len):
        if not chosen & set(extras):
            chosen.add(extras[0])
    return [extra for extra in EXTRAS if extra in chosen]


def _command(modules: list[str]) -> str:
    """Return the command that installs some modules."""
    extras = extras_with(modules)
    return f"pip install 'whiptool[{','.join(extras)}]'" if extras else f"pip install {' '.join(modules)}"
