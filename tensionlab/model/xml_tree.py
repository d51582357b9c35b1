"""XML files whose every complaint names the file, the line, the element and the attribute."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from os import PathLike
from typing import NoReturn
from xml.parsers import expat

import numpy as np

from tensionlab.arrays import Floats
from tensionlab.errors import RigError
from tensionlab.files.reading import MAX_NESTING, brief, read_bytes


@dataclass
class Element:
    """What does one element of an XML file hold?

    Attributes
    ----------
    tag : str
    attributes : dict of str to str
    where : str
        File and line, for errors.
    text : str
        Between its tags, without that of its children.
    children : list of Element
    """

    tag: str
    attributes: dict[str, str]
    where: str
    text: str = ""
    children: list[Element] = field(default_factory=list)

    def fail(self, problem: str) -> NoReturn:
        """Raise a RigError about this element."""
        name = self.attributes.get("name") or self.attributes.get("id")
        raise RigError(f"{self.where}: <{self.tag:.40}>{f' {brief(name)}' if name else ''}: {problem:.180}")

    def attribute(self, name: str) -> str:
        """Read an attribute that must be there."""
        if not self.attributes.get(name):
            self.fail(f'attribute "{name}" is missing; give it a value')
        return self.attributes[name]

    def all(self, tag: str) -> Iterator[Element]:
        """Go through the children of one tag."""
        return (child for child in self.children if child.tag == tag)

    def only(self, tag: str) -> Element:
        """Get the child of which there must be one."""
        found = list(self.all(tag))
        if len(found) != 1:
            self.fail(f"has {len(found) or 'no'} elements <{tag}>; give it one")
        return found[0]

    def numbers(self, count: int) -> Floats:
        """Read so many finite numbers from the text."""
        return self._numbers(self.text, count, "its text")

    def attribute_numbers(self, name: str, count: int) -> Floats:
        """Read so many finite numbers from an attribute."""
        return self._numbers(self.attribute(name), count, f'attribute "{name}"')

    def _numbers(self, text: str, count: int, what: str) -> Floats:
        try:
            values = np.array([float(word) for word in text.split()])
        except ValueError:
            values = np.empty(0)
        if values.size != count or not np.isfinite(values).all():
            self.fail(f"{what} is {brief(text.strip())}; give {count} finite number{'s' if count > 1 else ''}")
        return values


def read_xml(path: str | PathLike[str], root: str) -> Element:
    """Which tree does an XML file hold?

    A DOCTYPE may name a DTD, which is never read. Entities are refused: they could make a file grow without
    bound, or hold other files.

    Raises
    ------
    RigError
        Naming the file and the line, if the file cannot be read, is not well-formed, has another root element,
        or uses entities.
    """
    data = read_bytes(path, "an XML file", RigError)
    parser = expat.ParserCreate()
    top = Element("", {}, str(path))
    open_elements = [top]

    def start(tag: str, attributes: dict[str, str]) -> None:
        element = Element(tag, attributes, f"{path}: line {parser.CurrentLineNumber}")
        open_elements[-1].children.append(element)
        open_elements.append(element)
        if len(open_elements) > MAX_NESTING:
            element.fail(f"stands in {MAX_NESTING - 1} others; give a flatter file")

    def text(words: str) -> None:
        open_elements[-1].text += words

    def refuse(name: str, *_: object) -> NoReturn:
        line = parser.CurrentLineNumber
        raise RigError(f'{path}: line {line}: entity "{name}"; write what it stands for, entities are not read')

    parser.buffer_text = True
    parser.StartElementHandler = start
    parser.EndElementHandler = lambda tag: open_elements.pop()
    parser.CharacterDataHandler = text
    parser.EntityDeclHandler = refuse
    parser.SkippedEntityHandler = refuse
    try:
        parser.Parse(data, True)
    except (expat.ExpatError, LookupError, ValueError) as error:  # the last two for encodings
        raise RigError(f"{path}: not well-formed XML: {error}; correct that line") from None
    found = top.children[0]  # well-formed XML has just one
    if found.tag != root:
        found.fail(f"the root element must be <{root}>; give the file that has it")
    return found
