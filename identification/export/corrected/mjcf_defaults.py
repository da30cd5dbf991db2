"""Looks up attributes of MJCF elements, in the element itself or in its default classes."""

from __future__ import annotations

from dataclasses import dataclass
from math import degrees

from phantom_dyn.model.robot_xml import Element

ACTUATORS = ("general", "motor", "position", "velocity", "intvelocity", "damper", "cylinder", "muscle", "adhesion")
"""Actuator elements; in a default class, defaults of one of these tags hold for all of them."""


@dataclass(frozen=True)
class GivenMjcf:
    """An MJCF with look-ups of its elements, defaults and unit of angles.

    Attributes:
        root: Root element of the file.
        owners: Parent of each element.
        joints: Joints of bodies by name.
    """

    root: Element
    owners: dict[Element, Element]
    joints: dict[str, Element]

    @property
    def degrees(self) -> bool:
        """True if angles of hinges are in degrees, which is MuJoCo's default."""
        stated = [compiler.get("angle") for compiler in self.root.iter("compiler") if compiler.get("angle")]
        return not stated or stated[-1] != "radian"

    def angle(self, joint: Element, value: float) -> float:
        """A position of a joint [rad or m] in the unit of the file."""
        hinge = self.attribute(joint, "type") in (None, "hinge")
        return degrees(value) if hinge and self.degrees else value

    def attribute(self, element: Element, name: str) -> str | None:
        """An attribute of an element, or its default from the element's class or the ``childclass`` of its bodies."""
        if element.get(name) is not None:
            return element.get(name)
        tags = ACTUATORS if element.tag in ACTUATORS else (str(element.tag),)
        for default in self._defaults(element.get("class") or self._class_around(element)):
            for own in default:
                if own.tag in tags and own.get(name) is not None:
                    return own.get(name)
        return None

    def _class_around(self, element: Element) -> str | None:
        """The ``childclass`` of the nearest body around an element."""
        owner = self.owners.get(element)
        while owner is not None:
            if owner.tag == "body" and owner.get("childclass"):
                return owner.get("childclass")
            owner = self.owners.get(owner)
        return None

    def _defaults(self, name: str | None) -> list[Element]:
        """The ``<default>`` element of a class, then those around it; without a class the outermost one."""
        outer = self.root.findall("default")
        if name is None:
            return outer
        found = next((default for default in self.root.iter("default") if default.get("class") == name), None)
        out: list[Element] = []
        while found is not None and found.tag == "default":
            out.append(found)
            found = self.owners.get(found)
        return out or outer


def given_mjcf(root: Element) -> GivenMjcf:
    """The look-ups of an MJCF.

    Args:
        root: Root element of the file.
    """
    owners = {child: element for element in root.iter() for child in element}
    joints = {str(j.get("name")): j for world in root.iter("worldbody") for j in world.iter("joint") if j.get("name")}
    return GivenMjcf(root, owners, joints)
