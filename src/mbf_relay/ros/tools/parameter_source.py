"""Parameters read from YAML and launch files, each with its file and line."""

from __future__ import annotations

import copy
import itertools
import os
import re
import shlex
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Callable, Dict, Iterable, List, Mapping, NamedTuple, Tuple
from xml.etree.ElementTree import Element

import yaml

from mbf_relay import files
from mbf_relay.ros.tools.launch_arguments import check_argument

if TYPE_CHECKING:
    from mbf_relay.ros.tools.substitution import Substitution

TYPES = {
    "move_base": "move_base", "mbf_costmap_nav": "move_base_flex", "move_base_flex": "move_base_flex", "amcl": "amcl",
}
"""Executables whose parameters are checked, each with the node of this package that replaces it."""
COMPOSE = "compose"
"""The executable that runs several nodes, given as its arguments: `-- NODE [ARGUMENT...] -- NODE ...`."""
NAMED = "__name:="
DEEPEST_INCLUDE = 20
CONTROL = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f]")


@dataclass
class ParameterSource:
    """The parameters in a namespace, and where each was read.

    Attributes:
        values: Values, nested as in the files.
        places: "FILE:LINE" by the parameter's name, its parts joined by slashes.
        trouble: Doubts about the files themselves: parameter's name and text.
        missing: Files and values that could not be read: the namespace they are for, and the reason.
    """

    values: Dict[str, Any] = field(default_factory=dict)
    places: Dict[str, str] = field(default_factory=dict)
    trouble: List[Tuple[str, str]] = field(default_factory=list)
    missing: List[Tuple[str, str]] = field(default_factory=list)

    def put(self, name: str, value: Any, place: str) -> None:
        """Set a value, as the parameter server does: groups are merged, all else is replaced."""
        *groups, last = [part for part in name.split("/") if part]
        here = self.values
        for group in groups:
            there = here.setdefault(group, {})
            if not isinstance(there, dict):
                there = here[group] = {}
            here = there
        here[last] = value
        self.places["/".join([*groups, last])] = place

    def below(self, name: str) -> ParameterSource:
        """Return a group as a source, names relative to it; `missing` includes all that may have set its parameters."""
        values: Any = self.values
        for part in name.split("/"):
            values = values.get(part, {}) if isinstance(values, dict) else {}
        prefix = f"{name}/"

        def cut(pairs: Iterable[Tuple[str, str]]) -> List[Tuple[str, str]]:
            return [
                (f"{full}/"[len(prefix):].strip("/"), text) for full, text in pairs if f"{full}/".startswith(prefix)]

        above = [
            ("", text) for full, text in self.missing if full != name and prefix.startswith(f"{full}/".lstrip("/"))]
        return ParameterSource(
            copy.deepcopy(values) if isinstance(values, dict) else {}, dict(cut(self.places.items())),
            cut(self.trouble), cut(self.missing) + above)

    def place(self, name: str) -> str:
        """Return "FILE:LINE" of a parameter, else of one below it, else of its group; empty where there is none."""
        while name:
            if name in self.places:
                return self.places[name]
            below = [place for known, place in self.places.items() if known.startswith(name + "/")]
            if below:
                return below[0]
            name = name.rpartition("/")[0]
        return ""


class LaunchedNode(NamedTuple):
    """A node of a launch file: its name, its type in this package, its parameters, and those of the whole graph."""

    name: str
    type: str
    source: ParameterSource
    graph: ParameterSource = ParameterSource()

    @property
    def is_server(self) -> bool:
        """Whether it plans and drives: a file missing for it is an error, while amcl would only be left out."""
        return self.type != "amcl"


class Launch(NamedTuple):
    """The contents of a launch file and its includes.

    Attributes:
        nodes: The nodes of TYPES.
        not_read: A sentence for each file or value that is missing and that no server needs.
    """

    nodes: List[LaunchedNode]
    not_read: List[str]


def read_yaml(
    path: str, namespace: str, source: ParameterSource, substitute: Callable[[str], str] = str
) -> None:
    """Add a YAML file's values to a source, with their lines.

    Args:
        path: The file.
        namespace: Namespace of the values in the source; empty for its root.
        source: Takes the values.
        substitute: Function that resolves $(…) in the file's text.

    Raises:
        ValueError: It is no valid YAML, or no mapping at the top; the text names file and line.
        OSError: It cannot be read.
    """
    add_yaml(substitute(files.read_text(path)), path, namespace, source)


def add_yaml(text: str, path: str, namespace: str, source: ParameterSource) -> None:
    """Add the values of a YAML text to a source; arguments and errors as for `read_yaml`."""
    for number, line in enumerate(text.splitlines(), 1):
        if "\t" in line[: len(line) - len(line.lstrip())]:
            raise ValueError(f"{path}:{number}: the line begins with a tab; YAML is indented with blanks")
    loader = files.YamlLoader(CONTROL.sub(" ", text))
    try:
        root = loader.get_single_node()
        if root is None:
            return
        values = files.parse_yaml(text)  # checks size and depth
        if not isinstance(values, Mapping):
            raise ValueError(f"{path}:{root.start_mark.line + 1}: it holds {values!r} and no names")
        _add(root, loader, namespace, path, source)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = f":{mark.line + 1}" if mark is not None else ""
        raise ValueError(f"{path}{line}: {getattr(error, 'problem', None) or error}") from error
    finally:
        loader.dispose()


def _add(node: Any, loader: Any, namespace: str, path: str, source: ParameterSource) -> None:
    """Add the values of a YAML mapping, group by group.

    Args:
        node, loader: The mapping's YAML node, and the loader that constructs its values.
        namespace, path: Namespace of the mapping, and path of its file.
        source: Takes the values.
    """
    seen: Dict[str, int] = {}
    written = {id(key) for key, _ in node.value}  # other keys come from a merge (<<) and may be overridden
    loader.flatten_mapping(node)
    for key, value in node.value:
        name = str(loader.construct_object(key, deep=True)).strip("/")
        full, line = f"{namespace}/{name}".strip("/"), key.start_mark.line + 1
        if name in seen:
            source.trouble.append((full, f"stands twice, in lines {seen[name]} and {line}; the last one holds"))
        if id(key) in written:
            seen[name] = line
        if isinstance(value, yaml.MappingNode) and value.value:
            _add(value, loader, full, path, source)
        else:
            source.put(full, loader.construct_object(value, deep=True), f"{path}:{line}")


def read_launch(path: str, given: Mapping[str, str]) -> Launch:
    """Return the nodes of TYPES that a launch file and its includes launch.

    Args:
        path: The file.
        given: Values of the launch file's arguments, by name.

    Raises:
        ValueError: It is invalid, or a server's file or value is missing; the text names the file.
        OSError: It or a file it names cannot be read.
    """
    from mbf_relay.ros.tools.substitution import Substitution

    reader = _LaunchReader(path, Substitution(path, given), "", 0, ParameterSource(), Launch([], []))
    return reader.launch()


def _joined(*names: str) -> str:
    """Return names joined by slashes, without a leading one; those before an absolute name are dropped."""
    full = ""
    for name in names:
        full = name if name.startswith("/") else f"{full}/{name}"
    return "/".join(part for part in full.split("/") if part)


class _LaunchReader:
    """Reads from a launch file what sets parameters of nodes of TYPES, as roslaunch does."""

    def __init__(
        self, path: str, substitution: Substitution, namespace: str, depth: int, parameters: ParameterSource,
        launch: Launch,
    ) -> None:
        """Read it.

        Args:
            path, depth: The file, and the number of includes that led to it.
            substitution: Has the arguments given from outside, which override the file's defaults.
            namespace: Namespace in which the file is included.
            parameters: Takes parameters by their full names; later values override earlier ones.
            launch: Takes nodes, and texts on missing files.
        """
        if depth > DEEPEST_INCLUDE:
            raise ValueError(f"{path}: includes are nested deeper than {DEEPEST_INCLUDE}")
        self._path, self._substitution, self._depth, self._parameters = path, substitution, depth, parameters
        self._launch = launch
        with files.open_regular(path) as file:
            text = file.read()
        root = files.parse_xml(text, path)
        self._lines = files.xml_lines(text, root)
        self._walk(root, namespace)

    def launch(self) -> Launch:
        """Return the nodes, each with all its parameters, also those set outside of its element.

        Raises:
            ValueError: A file that may set a server's parameters is missing; the text names it.
        """
        graph = self._parameters
        nodes = [node._replace(source=graph.below(node.name), graph=graph) for node in self._launch.nodes]
        not_read = list(self._launch.not_read)
        for node in nodes:
            for _, text in node.source.missing:
                if node.is_server:
                    raise ValueError(text)
                not_read.append(text)
        return Launch([node for node in nodes if not node.source.missing], not_read)

    def _walk(self, parent: Element, namespace: str) -> None:
        for element in parent:
            if not isinstance(element.tag, str) or not self._applies(element):
                continue
            if element.tag == "arg":
                self._take_argument(element)
            elif element.tag == "group":
                self._walk(element, _joined(namespace, self._text(element, "ns")))
            elif element.tag == "include":
                self._include(element, namespace)
            elif element.tag in ("param", "rosparam"):
                self._take_outside(element, namespace)
            elif element.tag == "node" and self._text(element, "type") in TYPES:
                self._take_node(element, namespace)
            elif element.tag == "node" and self._text(element, "type") == COMPOSE:
                self._take_members(element, namespace)

    def _take_node(self, element: Element, namespace: str) -> None:
        name = _joined(namespace, self._text(element, "ns"), self._text(element, "name"))
        node = LaunchedNode(name, TYPES[self._text(element, "type")], self._parameters)
        for child in element:
            if isinstance(child.tag, str) and self._applies(child):
                try:
                    self._take_values(child, _joined(name, self._text(child, "ns")))
                except (ValueError, OSError) as error:
                    if node.is_server:
                        raise
                    self._parameters.missing.append((name, str(error)))
        self._take_private(self._words(element), name, element)
        self._launch.nodes.append(node)

    def _take_members(self, element: Element, namespace: str) -> None:
        """Take the nodes of TYPES that compose runs, each after a "--"; assignments after the last one are for all."""
        lines = [list(line) for is_end, line in itertools.groupby(self._words(element), "--".__eq__) if not is_end]
        for_all = lines.pop() if lines and all(":=" in word for word in lines[-1]) else []
        for program, *rest in lines:
            if program in TYPES:
                given = [word[len(NAMED):] for word in rest if word.startswith(NAMED)]
                name = _joined(namespace, self._text(element, "ns"), (given or [program])[-1])
                self._take_private((*rest, *for_all), name, element)
                self._launch.nodes.append(LaunchedNode(name, TYPES[program], self._parameters))

    def _words(self, element: Element) -> List[str]:
        """Return the words of a node's command line; ValueError where a quotation is not closed."""
        text = self._text(element, "args")
        try:
            return shlex.split(text)
        except ValueError as error:
            raise ValueError(f'{self._path}:{self._lines[element][0]}: args="{text}": {error}') from error

    def _take_private(self, words: Iterable[str], name: str, element: Element) -> None:
        """Take the parameters on a node's command line, such as `_odom_frame_id:=odom`, which override all others."""
        for word in words:
            key, assigned, value = word.partition(":=")
            if assigned and key.startswith("_") and not key.startswith("__"):
                self._parameters.put(f"{name}/{key[1:]}", _typed(value), f"{self._path}:{self._lines[element][0]}")

    def _take_outside(self, element: Element, namespace: str) -> None:
        """Take parameters set outside of a node element; a missing file is an error only for nodes it may concern."""
        full = _joined(namespace, self._text(element, "ns"), self._text(element, "name"))
        try:
            self._take_values(element, full, True)
        except (ValueError, OSError) as error:
            self._parameters.missing.append((full, str(error)))

    def _take_values(self, element: Element, namespace: str, named: bool = False) -> None:
        """Add the values of a <param> or <rosparam>.

        Args:
            element: The element.
            namespace: Its namespace.
            named: Whether `namespace` includes a <param>'s name already.
        """
        source, (line, line_of_text) = self._parameters, self._lines[element]
        if element.tag == "param" and element.get("value") is not None:
            name = namespace if named else f"{namespace}/{self._text(element, 'name').lstrip('~')}"
            source.put(name, self._value(element, line), f"{self._path}:{line}")
        elif element.tag == "rosparam" and element.get("command", "load") == "load":
            target = f"{namespace}/{self._text(element, 'param').lstrip('~')}".strip("/")
            is_substituted = element.get("subst_value", "").lower() == "true"
            substitute = self._substitution.resolved if is_substituted else str
            if element.get("file"):
                path = self._text(element, "file")
                if not os.path.exists(path):
                    raise ValueError(f"{path}: there is no such file; {self._path}:{line} loads it")
                read_yaml(path, target, source, substitute)
            elif element.text and element.get("param"):
                source.put(target, _typed(substitute(element.text)), f"{self._path}:{line}")
            elif element.text:
                add_yaml("\n" * (line_of_text - 1) + substitute(element.text), self._path, target, source)

    def _value(self, element: Element, line: int) -> Any:
        """Return a <param>'s value as roslaunch converts it; errors name the given line."""
        from roslaunch.loader import convert_value

        text = self._text(element, "value")
        try:
            return convert_value(text.strip(), element.get("type") or "auto")
        except ValueError as error:
            raise ValueError(f"{self._path}:{line}: roslaunch refuses {text!r}: {error}") from error

    def _take_argument(self, element: Element) -> None:
        name, value, default = self._text(element, "name"), element.get("value"), element.get("default")
        if value is not None:
            self._substitution.give(name, value, self._substitution)
        elif default is not None and not self._substitution.knows(name):
            self._substitution.give(name, default, self._substitution)

    def _include(self, element: Element, namespace: str) -> None:
        """Read an included file; a missing one, as of another package, is noted and left out."""
        from mbf_relay.ros.tools.substitution import Substitution

        try:
            path = self._text(element, "file")
        except ValueError as error:
            self._launch.not_read.append(str(error))
            return
        if not os.path.isfile(path):
            self._launch.not_read.append(f"{path}: there is no such file; {self._path} includes it")
            return
        passed, passes_all = Substitution(path), element.get("pass_all_args", "").lower() == "true"
        if passes_all:
            passed.give_all(self._substitution)
        for child in element:
            if child.tag == "arg" and self._applies(child):
                name = self._text(child, "name")
                if not passes_all:
                    check_argument(name, [path])
                passed.give(name, child.get("value") or child.get("default") or "", self._substitution)
        within = _joined(namespace, self._text(element, "ns"))
        _LaunchReader(path, passed, within, self._depth + 1, self._parameters, self._launch)

    def _applies(self, element: Element) -> bool:
        wanted, unwanted = element.get("if"), element.get("unless")
        return (wanted is None or self._is_true(wanted)) and (unwanted is None or not self._is_true(unwanted))

    def _is_true(self, text: str) -> bool:
        value = self._substitution.resolved(text).strip().lower()
        if value not in ("true", "1", "false", "0"):
            raise ValueError(f"{self._path}: '{value}' is neither true nor false, as an if or unless must be")
        return value in ("true", "1")

    def _text(self, element: Element, name: str) -> str:
        return self._substitution.resolved(element.get(name) or "")


def _typed(text: str) -> Any:
    """Return a text as roslaunch converts it where no type is given."""
    try:
        return files.parse_yaml(text)
    except ValueError:
        return text
