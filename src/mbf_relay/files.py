"""Reading of users' files (text, XML, YAML) with limits on size, nesting and aliases, and without blocking on pipes."""

from __future__ import annotations

import ast
import math
import operator
import os
import re
import stat
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, Callable, Dict, List, Set, Tuple, Union

import yaml

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

LARGEST_TEXT = 64 << 20
"""Largest size (bytes) of a text file."""
MOST_NODES = 1000000
"""Values in a YAML document once its aliases are written out."""
LONGEST_ANGLE = 80
"""Largest number of characters in the expression of an angle."""
CALCULATIONS: Dict[type, Callable[..., float]] = {
    ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul, ast.Div: operator.truediv,
    ast.USub: operator.neg, ast.UAdd: operator.pos,
}
"""Operators allowed in the expression of an angle."""


class YamlLoader(yaml.SafeLoader):  # type: ignore[misc]
    """PyYAML's safe loader with rosparam's angles: `!degrees 60`, `deg(60)`, `!radians pi/2`, `rad(2*pi)`.

    rosparam adds these forms to PyYAML's own loader and evaluates them as Python; here only arithmetic is allowed.
    """


def _angle(unit: float, name: str) -> Callable[[YamlLoader, Any], float]:
    """Return a YAML constructor that converts a scalar to radians.

    Args:
        unit: Radians in one unit of the scalar.
        name: Function name that may be written around the angle: "deg" or "rad".
    """
    def construct(loader: YamlLoader, node: Any) -> float:
        text = str(loader.construct_scalar(node)).strip()
        inner = text[len(name) + 1:-1] if text.startswith(f"{name}(") else text
        try:
            if len(inner) > LONGEST_ANGLE:
                raise ValueError
            return unit * _calculated(ast.parse(inner.strip(), mode="eval").body)
        except (SyntaxError, ValueError, ArithmeticError) as error:
            trouble = f"'{text[:40]}' is no angle"
            raise yaml.constructor.ConstructorError(None, None, trouble, node.start_mark) from error

    return construct


def _calculated(part: Any) -> float:
    """Evaluate an arithmetic expression of numbers and pi; ValueError for anything else."""
    if isinstance(part, ast.Constant) and type(part.value) in (int, float):
        return float(part.value)
    if isinstance(part, ast.Name) and part.id == "pi":
        return math.pi
    if isinstance(part, ast.UnaryOp) and type(part.op) in CALCULATIONS:
        return CALCULATIONS[type(part.op)](_calculated(part.operand))
    if isinstance(part, ast.BinOp) and type(part.op) in CALCULATIONS:
        return CALCULATIONS[type(part.op)](_calculated(part.left), _calculated(part.right))
    raise ValueError("it is no calculation")


for tag, unit, name in (("!degrees", math.pi / 180.0, "deg"), ("!radians", 1.0, "rad")):
    YamlLoader.add_constructor(tag, _angle(unit, name))
    YamlLoader.add_implicit_resolver(tag, re.compile(rf"^{name}\([^)]*\)$"), first=[name[0]])


def config_folder() -> Path:
    """Return the package's config folder: of the source tree, or of the install space this module lies in.

    Raises:
        ValueError: There is none; the package is not installed as a whole.
    """
    here = Path(__file__).resolve()
    candidates = [here.parents[2] / "config"]
    if len(here.parents) > 4:
        candidates.append(here.parents[4] / "share" / "mbf_relay" / "config")
    for folder in candidates:
        if (folder / "move_base_flex.yaml").is_file():
            return folder
    raise ValueError(f"the package's config folder was not found; looked for {' and '.join(map(str, candidates))}")


def open_regular(path: str, largest: int = LARGEST_TEXT) -> BinaryIO:
    """Open a regular file for reading; others are refused, since e.g. a pipe without a writer would block for ever.

    Args:
        path: The file.
        largest: Largest size allowed (bytes).

    Raises:
        OSError: It cannot be opened.
        ValueError: It is no regular file, or too large.
    """
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
    state = os.fstat(descriptor)
    if stat.S_ISREG(state.st_mode) and state.st_size <= largest:
        return os.fdopen(descriptor, "rb")
    os.close(descriptor)
    if stat.S_ISDIR(state.st_mode):
        raise IsADirectoryError(21, "Is a directory", path)
    if not stat.S_ISREG(state.st_mode):
        raise ValueError(f"{path} is no regular file")
    raise ValueError(f"{path} has {state.st_size} bytes; at most {largest} are read")


def read_text(path: str, largest: int = LARGEST_TEXT) -> str:
    """Return what a text file holds; errors as for `open_regular`, and ValueError where it is no UTF-8."""
    with open_regular(path, largest) as file:
        content = file.read()
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        byte = content[error.start]
        raise ValueError(f"{path}:{line}: byte 0x{byte:02x} is no UTF-8; save the file as that") from error


def read_xml(path: str) -> Element:
    """Return the root of an XML file; errors as for `open_regular`, and ValueError where it is no XML."""
    with open_regular(path) as file:
        return parse_xml(file.read(), path)


def parse_xml(text: Union[str, bytes], where: str) -> Element:
    """Return the root of an XML text; ValueError, which names where it comes from, where it is none."""
    from defusedxml import DefusedXmlException, ElementTree  # no node reads any but the simulator

    try:
        root: Element = ElementTree.fromstring(text)
        return root
    except (ElementTree.ParseError, DefusedXmlException, LookupError, ValueError) as error:
        raise ValueError(f"{where} is no XML: {error}") from error


class _XmlLines:
    """Target of an XML parser that records the lines in which each element and its text begin."""

    def __init__(self) -> None:
        self.lines: List[List[int]] = []
        self.expat: Any = None

    def start(self, _tag: str, _attributes: Dict[str, str]) -> None:
        """Take an element's first tag."""
        self.lines.append([self.expat.CurrentLineNumber, 0])

    def data(self, _text: str) -> None:
        """Take a piece of text, of which only an element's first is noted."""
        if self.lines and not self.lines[-1][1]:
            self.lines[-1][1] = self.expat.CurrentLineNumber

    def end(self, _tag: str) -> None:
        """Take an element's last tag."""

    def close(self) -> None:
        """End."""


def xml_lines(text: bytes, root: Element) -> Dict[Element, Tuple[int, int]]:
    """Return the lines in which each element of an XML text begins, and its own text.

    Args:
        text: The document.
        root: What `parse_xml` made of it.
    """
    from defusedxml import ElementTree

    target = _XmlLines()
    parser = ElementTree.XMLParser(target=target)
    target.expat = parser.parser
    parser.parser.buffer_text = False  # text would come when it has ended
    parser.feed(text)
    parser.close()
    return {element: (first, inner) for element, (first, inner) in zip(root.iter(), target.lines)}


def parse_yaml(text: str) -> Any:
    """Return the values of a YAML document.

    Raises:
        ValueError: It is none, is nested too deeply, or holds aliases that would unfold to more than MOST_NODES values.
    """
    loader = None
    try:
        loader = YamlLoader(text)
        node = loader.get_single_node()
        if node is None:
            return None
        if _unfolded(node, {}, set()) > MOST_NODES:
            raise ValueError(f"its aliases unfold to more than {MOST_NODES} values")
        return loader.construct_document(node)
    except yaml.YAMLError as error:
        raise ValueError(" ".join(str(error).split())) from error
    except RecursionError as error:
        raise ValueError("it is nested too deeply") from error
    finally:
        if loader is not None:
            loader.dispose()


def _unfolded(node: Any, known: Dict[int, int], above: Set[int]) -> int:
    """Return how many values a node stands for with its aliases written out."""
    if isinstance(node, yaml.ScalarNode):
        return 1
    if id(node) in above:
        raise ValueError("it holds an alias of what the alias stands in")
    if id(node) not in known:
        parts = node.value if isinstance(node, yaml.SequenceNode) else [part for pair in node.value for part in pair]
        known[id(node)] = 1 + sum(_unfolded(part, known, above | {id(node)}) for part in parts)
    return known[id(node)]
