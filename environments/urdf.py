"""URDF reader, which checks a file before anything builds an arm from it: small, plain XML, a tree of joints,
physically possible.

All code that reads a URDF gets the tree that `parse` returns, never the file: it has no DOCTYPE, no entity, and no
reference to anything outside.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree
from collections import Counter
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from environments.regular_file import read_regular

LARGEST = 5_000_000  # bytes
MOST_ELEMENTS = 50_000
DEEPEST = 32
MOST_LINKS = 300
MOST_VISUALS = 500
JOINT_TYPES = ("revolute", "continuous", "prismatic", "fixed")
FULL_TURN = 2 * np.pi  # rad, either way: range that a continuous joint gets
ENDLESS = "endless"  # attribute that a joint gets which was continuous
MESHES = (".stl", ".dae", ".obj")
SHAPES = {"box": {"size": 3}, "sphere": {"radius": 1}, "cylinder": {"radius": 1, "length": 1}, "mesh": {"scale": 3}}
WORLD = "universe"  # Pinocchio's name for the frame in which the arm stands
DEFAULT_SIZES = {1: "1", 3: "1 1 1"}
LONGEST = 200  # characters, of a name and of the numbers of an attribute
NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?", re.ASCII)  # numbers that C++ and Python read alike
LARGEST_MESH = 60_000_000  # bytes
ROUNDED = 1e-6  # kg m^2: a negative eigenvalue up to this size may be zero, rounded in the file
NO_EFFORT = "1e6"  # N m: effort limit that a continuous joint without limits gets, so large that it is none
FARTHEST = 1e6  # no number in SI units that describes an arm is larger


class RobotError(ValueError):
    """A robot description that cannot be used; the message names the robot, what is wrong and what is allowed."""


def read(path: Path) -> Element:
    """Root of a URDF file. Raises RobotError for a file that cannot be read, and for one that `parse` refuses."""
    shown = f"{path!s:.200}"
    try:
        content = read_regular(path, LARGEST + 1)
    except FileNotFoundError as error:
        raise RobotError(f"robot.urdf: cannot read {shown}: no such file") from error
    except (
        OSError,
        ValueError,
    ) as error:  # a name too long or with a zero in it, a closed folder, a pipe
        reason = error.strerror if isinstance(error, OSError) else error
        raise RobotError(f"robot.urdf: cannot read {shown}: {reason}") from error
    return parse(content, path.name)


def parse(content: bytes, name: str) -> Element:
    """Root of a URDF's XML. Continuous joints are changed to revolute ones, so that each has one coordinate, and marked
    as `ENDLESS`; joints with the name of a link or of the world are renamed, since Pinocchio has one table of names for
    both.

    Raises RobotError, with `name` in it, for text that is no URDF, too large, not self-contained, no tree, or no body.
    """

    def refuse(what: str) -> RobotError:
        return RobotError(f"robot.urdf: {name:.60}: {what}")

    if len(content) > LARGEST:
        raise refuse(f"larger than {LARGEST / 1e6:g} MB")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise refuse("not XML in UTF-8") from error
    if re.search(r"<!\s*(DOCTYPE|ENTITY)", text, re.IGNORECASE):
        raise refuse("has a DOCTYPE or an entity; allowed: plain XML without either")
    try:
        root = ElementTree.fromstring(text, ElementTree.XMLParser(target=_Limited()))
        _require_urdf(root)
        _require_tree(root)
        _require_possible(root)
        _require_drawable(root)
    except ElementTree.ParseError as error:
        raise refuse(f"not XML: {error}") from error
    except _Refusal as error:
        raise refuse(str(error)) from error
    taken = {WORLD, *(_name(link) for link in root.findall("link"))}
    others = {_name(joint) for joint in root.findall("joint")} - taken
    for joint in root.findall("joint"):
        if _name(joint) in taken:
            new = f"{_name(joint)}_joint"
            while new in taken | others:
                new += "_joint"
            joint.set("name", new)
            taken.add(new)
        if joint.get("type") == "continuous":
            joint.set("type", "revolute")
            joint.set(ENDLESS, "true")
            limit = joint.find("limit")
            limit = ElementTree.SubElement(joint, "limit", effort=NO_EFFORT, velocity="10") if limit is None else limit
            limit.attrib |= {"lower": str(-FULL_TURN), "upper": str(FULL_TURN)}
    return root


def mesh_file(urdf: Path, filename: str) -> Path | None:
    """Path of a mesh that a URDF names: below the URDF's own folder or, after "package://", below that of the package
    around it, which is a folder of that name with a package.xml in it.

    None for a place elsewhere, another kind of file, and a missing file.
    """
    try:
        parents = urdf.resolve().parents
        if filename.startswith("package://"):
            package, _, inside = filename.removeprefix("package://").partition("/")
            home = next((at for at in parents if at.name == package and (at / "package.xml").is_file()), None)
        else:
            home, inside = parents[0], filename.removeprefix("file://")
        if home is None:
            return None
        path = (home / inside).resolve()
        wanted = path.is_relative_to(home) and path.suffix.lower() in MESHES and path.is_file()
        return path if wanted and path.stat().st_size <= LARGEST_MESH else None
    except (OSError, RuntimeError, ValueError):  # names too long, links in a circle, zeros in a name
        return None


class _Refusal(ValueError):
    """Reason why a URDF is refused, without the file's name."""


class _Limited(ElementTree.TreeBuilder):
    """Tree builder that limits nesting and number of elements while it reads: deep nesting is a danger to all later
    recursive code."""

    def __init__(self) -> None:
        super().__init__()
        self._depth = self._count = 0

    def start(self, tag: str, attrs: dict[str, str]) -> Element:
        self._depth += 1
        self._count += 1
        if self._depth > DEEPEST or self._count > MOST_ELEMENTS:
            raise _Refusal(f"allowed: at most {MOST_ELEMENTS} XML elements, nested at most {DEEPEST} deep")
        return super().start(tag, attrs)

    def end(self, tag: str) -> Element:
        self._depth -= 1
        return super().end(tag)


def _require_urdf(root: Element) -> None:
    if root.tag != "robot":
        raise _Refusal(f"no URDF: its root is <{root.tag:.40}>; allowed: <robot>")
    if any("xacro" in element.tag for element in root.iter()):
        raise _Refusal("a xacro file; allowed: the URDF that `xacro` makes of it")
    links, visuals = root.findall("link"), root.findall("link/visual")
    if not 1 <= len(links) <= MOST_LINKS:
        raise _Refusal(f"{len(links)} links; allowed: 1 to {MOST_LINKS}")
    if len(visuals) > MOST_VISUALS:
        raise _Refusal(f"{len(visuals)} visuals; allowed: at most {MOST_VISUALS}")
    for mesh in root.iter("mesh"):
        if re.match(r"(?!package:|file:)\w+://", filename := mesh.get("filename", "")):
            raise _Refusal(f"mesh {filename!r:.80} is elsewhere on the network; allowed: package:// or a relative path")


def _require_tree(root: Element) -> None:
    links = [_name(link) for link in root.findall("link")]
    joints = root.findall("joint")
    if WORLD in links:
        raise _Refusal(f"a link is called {WORLD!r}, as the world is; allowed: another name")
    for kind, names in (("links", links), ("joints", [_name(joint) for joint in joints])):
        name, times = Counter(names).most_common(1)[0] if names else ("", 0)
        if times > 1:
            raise _Refusal(f"two {kind} are called {name!r:.60}")
    children: dict[str, list[str]] = {link: [] for link in links}
    has_parent: set[str] = set()
    for joint in joints:
        parent, child = (_end(joint, end, children) for end in ("parent", "child"))
        if child in has_parent:
            raise _Refusal(f"link {child!r:.60} has two parents; allowed: a tree")
        has_parent.add(child)
        children[parent].append(child)
    roots = [link for link in links if link not in has_parent]
    reached, waiting = 0, roots[:1]
    while waiting:
        reached += 1
        waiting += children[waiting.pop()]
    if len(roots) > 1:
        raise _Refusal(f"links {roots[0]!r:.60} and {roots[1]!r:.60} both have no parent; allowed: one tree")
    if reached < len(links):
        raise _Refusal("its joints close a loop; allowed: a tree")


def _end(joint: Element, end: str, links: dict[str, list[str]]) -> str:
    element = joint.find(end)
    name = "" if element is None else element.get("link", "")
    if name not in links:
        raise _Refusal(f"joint {_name(joint)!r:.60} has no such {end} link: {name!r:.60}")
    return name


def _require_possible(root: Element) -> None:
    for joint in root.findall("joint"):
        what = f"joint {_name(joint)!r:.60}"
        kind = joint.get("type")
        if kind not in JOINT_TYPES:
            raise _Refusal(f"{what} is of type {kind!r:.40}; allowed: {', '.join(JOINT_TYPES)}")
        _placement(joint, what)
        if kind == "fixed":
            continue
        axis = _numbers(joint.find("axis"), "xyz", what, default="1 0 0", count=3)
        if np.linalg.norm(axis) < 1e-6:
            raise _Refusal(f"{what} has the axis 0 0 0; allowed: a direction")
        for tag, attributes in (("mimic", ("multiplier", "offset")), ("dynamics", ("damping", "friction"))):
            for attribute in attributes:
                _numbers(joint.find(tag), attribute, what, default="0")
        if kind == "continuous":
            continue
        limit = joint.find("limit")
        if limit is None:
            raise _Refusal(f"{what} has no limit; allowed: lower, upper, effort and velocity (or type continuous)")
        for attribute in ("effort", "velocity"):
            _numbers(limit, attribute, what)
        low, high = (_numbers(limit, attribute, what, default="0")[0] for attribute in ("lower", "upper"))
        if not low < high:
            raise _Refusal(f"{what} has the limits {low:g} to {high:g}; allowed: lower < upper")
    for link in root.findall("link"):
        for inertial in link.findall("inertial"):
            _require_body(inertial, f"link {_name(link)!r:.60}")


def _require_drawable(root: Element) -> None:
    """Refuse shapes without a size, and textures, which would be read from anywhere."""
    for link in root.findall("link"):
        what = f"link {_name(link)!r:.60}"
        for shape in link.findall("visual"):
            _placement(shape, what)
            for tag, sizes in SHAPES.items():
                for found in shape.findall(f"geometry/{tag}"):
                    for attribute, count in sizes.items():
                        if (_numbers(found, attribute, what, default=DEFAULT_SIZES[count], count=count) == 0.0).any():
                            raise _Refusal(f"{what}: {tag} with {attribute} = 0; allowed: another size")
    for material in root.iter("material"):
        for texture in material.findall("texture"):
            material.remove(texture)
        _numbers(material.find("color"), "rgba", "material", default="0 0 0 1", count=4)


def _require_body(inertial: Element, what: str) -> None:
    _placement(inertial, what)
    mass = _numbers(inertial.find("mass"), "value", what)[0]
    if mass < 0.0:
        raise _Refusal(f"{what} has the mass {mass:g} kg; allowed: > 0")
    tensor = inertial.find("inertia")
    xx, yy, zz, xy, xz, yz = (
        _numbers(tensor, f"i{ab}", what, default="0")[0] for ab in ("xx", "yy", "zz", "xy", "xz", "yz")
    )
    least = np.linalg.eigvalsh(np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))[0]
    if least < -ROUNDED:
        raise _Refusal(f"{what}: its inertia has the eigenvalue {least:.3g} kg·m²; allowed: positive definite")


def _placement(element: Element, what: str) -> None:
    for attribute in ("xyz", "rpy"):
        _numbers(element.find("origin"), attribute, what, default="0 0 0", count=3)


def _numbers(
    element: Element | None, attribute: str, what: str, default: str | None = None, count: int = 1
) -> np.ndarray:
    text = default if element is None else element.get(attribute, default)
    if text is None:
        raise _Refusal(f"{what} lacks {attribute!r}")
    if len(text) > LONGEST:  # a part of it would be another number than the one that Pinocchio reads
        raise _Refusal(f"{what}: {attribute} has {len(text)} characters; allowed: at most {LONGEST}")
    parts = text.split()
    numbers = np.array([float(part) if NUMBER.fullmatch(part) else np.nan for part in parts])
    if len(numbers) != count or not (np.abs(numbers) <= FARTHEST).all():
        allowed = f"{count} finite number(s) of at most {FARTHEST:g} in size"
        raise _Refusal(f"{what}: {attribute} = {text!r:.60}; allowed: {allowed}")
    return numbers


def _name(element: Element) -> str:
    name = element.get("name", "")
    if not name:
        raise _Refusal(f"a {element.tag:.40} without a name")
    if len(name) > LONGEST:
        raise _Refusal(f"{element.tag:.40} {name!r:.60}: {len(name)} characters; allowed: at most {LONGEST}")
    return name
