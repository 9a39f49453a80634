"""Edits of a URDF's text that preserve every other character."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from xml.parsers import expat
from xml.sax.saxutils import quoteattr

from bdnn_ros.errors import RobotError
from bdnn_ros.robot.urdf_file import DECLARED
from bdnn_ros.written import numbers


@dataclass
class Element:
    """An element with its place in the text, in bytes; `inner_end` is where its closing tag begins."""

    tag: str
    attributes: Mapping[str, str]
    start: int
    inner_end: int = -1
    end: int = -1
    children: list[Element] = field(default_factory=list)

    @property
    def name(self) -> str:
        """Its name attribute."""
        return self.attributes.get("name", "")

    def child(self, tag: str) -> Element | None:
        """The first child of that tag."""
        return next((child for child in self.children if child.tag == tag), None)


class UrdfText:
    """The text of a URDF, in which elements can be replaced and added.

    A declared encoding other than UTF-8 (possible in a bag) is changed to UTF-8, in which the text is written.

    Args:
        text: the URDF, well-formed.

    Raises:
        RobotError: it is not XML, or not of a robot.
    """

    def __init__(self, text: str) -> None:
        self.data = _declared_as_written(text).encode("utf-8")
        self.robot = _parsed(self.data)
        self._edits: list[tuple[int, int, str]] = []
        self._given: set[tuple[str, str]] = set()

    def elements(self, tag: str) -> list[Element]:
        """The robot's children of a tag: its links, or its joints."""
        return [child for child in self.robot.children if child.tag == tag]

    def named(self, tag: str, name: str) -> Element:
        """The link or joint with a name.

        Raises:
            KeyError: there is none.
        """
        for element in self.elements(tag):
            if element.name == name:
                return element
        raise KeyError(name)

    def root_link(self) -> str:
        """The link that is no joint's child."""
        children = [joint.child("child") for joint in self.elements("joint")]
        carried = {child.attributes.get("link") for child in children if child is not None}
        return next(link.name for link in self.elements("link") if link.name not in carried)

    def free_name(self, tag: str, wish: str) -> str:
        """A name that no such element has, reserved from now on."""
        taken = self._given | {(element.tag, element.name) for element in self.robot.children}
        names = [wish, *(f"{wish}_{k}" for k in range(2, len(taken) + 3))]
        name = next(name for name in names if (tag, name) not in taken)
        self._given.add((tag, name))
        return name

    def put(self, parent: Element, tag: str, text: str) -> None:
        """Replace the parent's child with a tag, or append it; an empty text removes it."""
        old = parent.child(tag)
        if old is not None:
            before = self.data[: old.start].rpartition(b"\n")[2]
            indent = "\n" + (before.decode("utf-8") if not before.strip() else "    ")
            self._edits.append((old.start, old.end, text.replace("\n", indent)))
        elif text:
            self.append(parent, text)

    def append(self, parent: Element, text: str) -> None:
        """Add text before the parent's closing tag."""
        indent = "\n" + "  " * (1 if parent is self.robot else 2)
        block = text.replace("\n", indent)
        if parent.inner_end >= 0:
            self._edits.append((parent.inner_end, parent.inner_end, f"  {block}{indent[:-2]}"))
        else:  # <link name="x"/> has to be opened
            opening = self.data[parent.start : parent.end - 2].rstrip().decode("utf-8")
            whole = f"{opening}>{indent}{block}{indent[:-2]}</{parent.tag}>"
            self._edits.append((parent.start, parent.end, whole))

    def text(self) -> str:
        """The text with all edits."""
        result, at = [], 0
        for start, end, new in sorted(self._edits, key=lambda edit: edit[:2]):
            result += [self.data[at:start], new.encode("utf-8")]
            at = end
        return b"".join([*result, self.data[at:]]).decode("utf-8")


def tag(name: str, /, *inside: str, **attributes: object) -> str:
    """An XML element; numbers in full precision, lists separated by blanks."""
    words = " ".join([name, *(f"{key}={quoteattr(_written(value))}" for key, value in attributes.items())])
    if not inside:
        return f"<{words}/>"
    lines = "\n".join(inside).replace("\n", "\n  ")
    return f"<{words}>\n  {lines}\n</{name}>"


def _written(value: object) -> str:
    if isinstance(value, str):
        return value
    if isinstance(value, (list, tuple)):
        return " ".join(_written(item) for item in value)
    return numbers(value)  # type: ignore[arg-type]


def _declared_as_written(text: str) -> str:
    """A text that declares UTF-8, or no encoding."""
    declared = DECLARED.match(text)
    if declared is None or declared[1].upper() == "UTF-8":
        return text
    return f"{text[: declared.start(1)]}UTF-8{text[declared.end(1) :]}"


def _parsed(data: bytes) -> Element:
    """The root element with its descendants."""
    parser = expat.ParserCreate("utf-8")
    stack: list[Element] = []
    roots: list[Element] = []

    def start(name: str, attributes: dict[str, str]) -> None:
        element = Element(name, attributes, parser.CurrentByteIndex)
        (stack[-1].children if stack else roots).append(element)
        stack.append(element)

    def end(name: str) -> None:
        element, at = stack.pop(), parser.CurrentByteIndex
        opening = _tag_end(data, element.start)
        if data[opening - 2 : opening] == b"/>":
            element.end = opening
        else:
            element.inner_end, element.end = at, _tag_end(data, at)

    parser.StartElementHandler, parser.EndElementHandler = start, end
    try:
        parser.Parse(data, True)
    except expat.ExpatError as error:
        raise RobotError(
            f"The robot description is not XML ({error}).", "Check it with check_urdf."
        ) from None
    if roots[0].tag != "robot":
        raise RobotError(f"The description's root is <{roots[0].tag}>, not <robot>.", "Give a URDF.")
    return roots[0]


def _tag_end(data: bytes, start: int) -> int:
    """End of the tag that begins at `start`; a `>` inside quotes does not end it."""
    at, quote = start, b""
    while True:
        byte = data[at : at + 1]
        at += 1
        if quote:
            quote = b"" if byte == quote else quote
        elif byte in (b'"', b"'"):
            quote = byte
        elif byte == b">":
            return at
