"""Shapes of URDF files: the capsules of links, and the inertia of links that have shapes but no `<inertial>`."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from whiptool.errors import InputError
from whiptool.models.capsules import Capsule
from whiptool.models.urdf_limits import number_of
from whiptool.models.urdf_numbers import plain_urdf
from whiptool.models.visuals import GREY, Surface

DENSITY = 1000.0  # [kg/m3], of bodies whose mass a file does not tell: what MuJoCo takes
SIMPLE = ("box", "cylinder", "capsule", "sphere")


def simple_shapes(model: Any, robot: ET.Element) -> Any:
    """Return the simple (non-mesh) collision shapes of a robot as a Pinocchio geometry model."""
    return _geometry(model, robot, "collision", lambda link: [x for x in link.findall("collision") if _is_simple(x)])


def visual_shapes(model: Any, robot: ET.Element, folder: Path) -> Any:
    """Return the visual shapes of a robot, whose mesh files are there, as a Pinocchio geometry model."""
    colours = {x.get("name"): x.find("color") for x in robot.findall("material")}
    for material in robot.iterfind("link/visual/material"):
        if material.find("color") is None and (colour := colours.get(material.get("name"))) is not None:
            material.append(colour)
    return _geometry(model, robot, "visual", lambda link: [x for x in link.findall("visual") if _is_there(x, folder)])


def look_of(shape: Any) -> Surface | Capsule:
    """Return a visual shape in its joint's frame."""
    import coal

    mesh = shape.geometry
    if not isinstance(mesh, coal.BVHModelBase):
        return capsule_of(shape)
    R, p = shape.placement.rotation, shape.placement.translation
    triangles = np.array([[t[0], t[1], t[2]] for t in (mesh.tri_indices(i) for i in range(mesh.num_tris))])
    r, g, b = map(float, shape.meshColor[:3]) if shape.overrideMaterial else GREY
    return Surface(np.array(mesh.vertices()) @ R.T + p, triangles.reshape(-1, 3), (r, g, b))


def capsule_of(shape: Any) -> Capsule:
    """Return a simple shape (capsule, cylinder, sphere or box) in its joint's frame as a `Capsule`."""
    import coal

    R, p, kind = shape.placement.rotation, shape.placement.translation, shape.geometry
    if isinstance(kind, coal.Box):
        return Capsule.around_box(R, p, np.array(kind.halfSide))
    flat = isinstance(kind, coal.Cylinder)
    return Capsule.along(R, p, float(getattr(kind, "halfLength", 0.0)), float(kind.radius), flat=flat)


def shaped_links(robot: ET.Element) -> set[str]:
    """Return the names of the links that have a visual or collision shape; other links are mere frames."""
    links = robot.findall("link")
    return {x.get("name", "") for x in links if x.find("visual") is not None or x.find("collision") is not None}


def with_meshes(robot: ET.Element) -> set[str]:
    """Return the names of the links that have a collision shape that is a mesh."""
    return {link.get("name", "") for link in robot.findall("link") if link.find("collision/geometry/mesh") is not None}


def massless_links(robot: ET.Element) -> set[str]:
    """Return the names of the links without an `<inertial>`, or with zero mass in it."""
    masses = {link.get("name", ""): link.find("inertial/mass") for link in robot.findall("link")}
    return {name for name, mass in masses.items() if not number_of(mass, "value") > 0}


def add_inertias(model: Any, robot: ET.Element, folder: Path, main: set[str]) -> set[str]:
    """Give massless moving bodies of a Pinocchio model the mass of their shapes, and return the names of their links.

    Links that are fixed to a link with mass may be mere frames; they get no mass. Collision shapes are used or, without
    these, visual shapes; meshes only if their files, relative to `folder`, exist. `main` names the links that are
    directly on moving joints.
    """
    import pinocchio as pin

    without = massless_links(robot) & shaped_links(robot)
    bodies_of = {frame.name: frame.parentJoint for frame in model.frames if frame.type == pin.FrameType.BODY}
    light = {name for name in without if not model.inertias[bodies_of[name]].mass}
    wanted = {name for name in without & (main | light) if bodies_of[name]}
    found: set[str] = set()
    for kind in ("collision", "visual"):
        left = wanted - found

        def shapes_of(link: ET.Element, kind: str = kind, left: set[str] = left) -> list[ET.Element]:
            return [x for x in link.findall(kind) if link.get("name") in left and _is_there(x, folder)]

        try:
            shapes = _geometry(model, robot, kind, shapes_of).geometryObjects
        except InputError:  # of a format that is not read
            continue
        bodies: dict[str, list[Any]] = {}
        for shape in shapes:
            bodies.setdefault(model.frames[shape.parentFrame].name, []).append(shape)
        for name, parts in bodies.items():
            inertias = [_inertia_of(part) for part in parts]
            if all(inertia is not None for inertia in inertias):
                joint = model.frames[model.getFrameId(name, pin.FrameType.BODY)].parentJoint
                for inertia in inertias:
                    model.appendBodyToJoint(joint, inertia, pin.SE3.Identity())
                found.add(name)
    return found


def _inertia_of(shape: Any) -> Any:
    """Return the inertia of a shape of water in its joint's frame; None: a mesh that encloses no volume."""
    import pinocchio as pin

    geometry = shape.geometry
    volume = float(geometry.computeVolume())
    moments = np.array(geometry.computeMomentofInertiaRelatedToCOM())
    if not volume > 0 or not np.isfinite(moments).all() or np.linalg.eigvalsh(moments)[0] < 0:
        return None
    inertia = pin.Inertia(DENSITY * volume, np.array(geometry.computeCOM()), DENSITY * moments)
    return shape.placement.act(inertia)


def _is_there(shape: ET.Element, folder: Path) -> bool:
    """Whether a shape is simple, or a mesh whose file is there; its name becomes the file's path."""
    mesh = shape.find("geometry/mesh")
    if mesh is None:
        return _is_simple(shape)
    name = mesh.get("filename", "")
    for scheme in ("package://", "file://", "model://"):
        name = name.removeprefix(scheme)
    places = [Path(name), *(above / name for above in (folder, *folder.parents)), folder / "meshes" / Path(name).name]
    found = next((place for place in places if place.is_file()), None)
    if found is not None:
        mesh.set("filename", str(found.resolve()))
    return found is not None


def _is_simple(shape: ET.Element) -> bool:
    return any(shape.find(f"geometry/{kind}") is not None for kind in SIMPLE)


def _geometry(model: Any, robot: ET.Element, kind: str, shapes: Callable[[ET.Element], list[ET.Element]]) -> Any:
    import pinocchio as pin

    try:
        return pin.buildGeomFromUrdfString(model, plain_urdf(robot, shapes), getattr(pin.GeometryType, kind.upper()))
    except (ValueError, RuntimeError) as error:
        raise InputError("file", "no shapes", "a URDF file whose shapes Pinocchio reads", f"reason: {error}") from None
