"""Files from outside, opened and read within bounds: nothing that blocks, explodes or takes the whole memory."""

from __future__ import annotations

import os
import stat
from pathlib import Path
from typing import Any, BinaryIO, Dict, Set
from xml.etree.ElementTree import Element

import yaml
from defusedxml import DefusedXmlException, ElementTree

LARGEST_TEXT = 64 << 20
"""Bytes of a file that is read whole."""
MOST_NODES = 1000000
"""Values in a YAML document once its aliases are written out."""


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
    """Open a file to read; what is no regular file, such as a pipe that nobody writes to, would block for ever.

    Args:
        path: The file.
        largest: Bytes it may have.

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
        return file.read().decode("utf-8")


def read_xml(path: str) -> Element:
    """Return the root of an XML file; errors as for `open_regular`, and ValueError where it is no XML."""
    with open_regular(path) as file:
        try:
            root: Element = ElementTree.parse(file).getroot()
            return root
        except (ElementTree.ParseError, DefusedXmlException, LookupError, ValueError) as error:
            raise ValueError(f"{path} is no XML: {error}") from error


def parse_yaml(text: str) -> Any:
    """Return the values of a YAML document.

    Raises:
        ValueError: It is none, is nested too deeply, or holds aliases that would unfold to more than MOST_NODES values.
    """
    loader = None
    try:
        loader = yaml.SafeLoader(text)
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
