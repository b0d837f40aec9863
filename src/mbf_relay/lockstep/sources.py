"""Identification of the code: the package's version, and hashes of its sources and of the user's plugins.

Results are comparable, and machines of a cluster drive equally, only where these agree.
"""

from __future__ import annotations

import functools
import hashlib
import importlib
import inspect
import os
import re
from pathlib import Path
from typing import Any, Dict, Iterator, List, Mapping, NamedTuple, Sequence, Tuple

from mbf_relay.control.critics import CRITICS
from mbf_relay.costmap import LAYERS
from mbf_relay.costmap.factory import COSTMAPS, layer_groups
from mbf_relay.costmap.layer import Layer
from mbf_relay.lockstep.own_modules import own_modules
from mbf_relay.lockstep.settings import config_folder, flatten
from mbf_relay.lockstep.setup import SERVER, Setup
from mbf_relay.navigation.plugin_lists import PLUGIN_LISTS
from mbf_relay.navigation.registry import entries_of, values_of
from mbf_relay.plugins import find_class

NOT_DRIVEN = ("ros", "view", "report")
"""Folders of the package that lockstep does not use."""
BUILT_IN = {*LAYERS, *CRITICS, *(name for listed in PLUGIN_LISTS for name in listed.known)}
"""Types of the package's own plugins, by upstream's names."""


class Sources(NamedTuple):
    """The code of one process.

    Attributes:
        version: The package's version.
        package: Hash over the package's modules that lockstep uses.
        plugins: Hash of each of the user's plugins, by type, over its module and what of the user's it imports.
    """

    version: str
    package: str
    plugins: Dict[str, str]

    def difference(self, other: Sources) -> str:
        """Return how `other` differs, for people; empty where it does not."""
        if self.version != other.version:
            return f"has version {other.version}, not {self.version}"
        if self.package != other.package:
            return f"has other sources of version {other.version} ({other.package}, not {self.package})"
        changed = sorted(name for name in self.plugins if self.plugins[name] != other.plugins.get(name))
        return f"has another {changed[0]} ({other.plugins.get(changed[0])})" if changed else ""


def sources(plugins: Sequence[str]) -> Sources:
    """Return this process' sources; for a plugin that cannot be imported its error takes the place of the hash."""
    return Sources(version(), package_digest(), {name: _plugin_digest(name) for name in plugins})


def plugins_of(setup: Setup) -> List[str]:
    """Return the types of the plugins in use that are not the package's own."""
    return sorted({name for name in _types(setup) if "." in name and not name.startswith("mbf_relay.")
                   and name not in BUILT_IN})


def files_of(setup: Setup) -> Dict[str, str]:
    """Return a hash of each file that a parameter of a user's plugin names, as a policy's weights, by parameter."""
    found = {}
    for name, kind, values in _plugins(setup.settings[SERVER], plugins_of(setup)):
        for parameter, value in flatten(kind.Parameters.read(values)[0].as_dict(), f"{name}.").items():
            if isinstance(value, str) and os.path.isfile(value):  # Path.is_file raises for a text that is too long
                found[parameter] = hashlib.sha256(Path(value).read_bytes()).hexdigest()[:16]
    return found


@functools.lru_cache(maxsize=None)
def version() -> str:
    """Return the package's version, as its package.xml states it."""
    text = (config_folder().parent / "package.xml").read_text(encoding="utf-8")
    found = re.search(r"<version>\s*([^<\s]+)\s*</version>", text)
    return found.group(1) if found else "unknown"


@functools.lru_cache(maxsize=None)
def package_digest() -> str:
    """Return a hash over the package's modules that lockstep uses."""
    folder = Path(__file__).resolve().parents[1]  # of the sources; a build's mbf_relay package only refers to them
    known = hashlib.sha256()
    for path in sorted(folder.rglob("*.py")):
        name = path.relative_to(folder)
        if name.parts[0] not in NOT_DRIVEN:
            known.update(f"{name.as_posix()}\0".encode() + path.read_bytes())
    return known.hexdigest()[:16]


@functools.lru_cache(maxsize=None)  # cached, as the process keeps the modules it has loaded when files change later
def _plugin_digest(name: str) -> str:
    try:
        module = name.rpartition(".")[0]
        loaded = importlib.import_module(module)
        parts = own_modules(module)
        if module not in parts:  # imported from a zip file
            parts[module] = inspect.getsource(loaded).encode()
        known = hashlib.sha256()
        for part, content in sorted(parts.items()):
            known.update(f"{part}\0{len(content)}\0".encode() + content)
        return known.hexdigest()[:16]
    except Exception as error:  # a user's module may raise anything when it is imported
        return f"{type(error).__name__}: {error}"


def _types(setup: Setup) -> Iterator[str]:
    server = setup.settings[SERVER]
    for listed in PLUGIN_LISTS:
        for entry in server.get(listed.kind, []):
            yield entry["type"]
            yield from map(str, server.get(entry["name"], {}).get("critics", []))
    for costmap in COSTMAPS:
        yield from (type_name for _, type_name, _ in layer_groups(server.get(costmap, {})))


def _plugins(server: Mapping[str, Any], types: Sequence[str]) -> Iterator[Tuple[str, Any, Mapping[str, Any]]]:
    """Return name, class and parameters of a server's plugins, and of its costmaps' layers, that are of some types."""
    for listed in PLUGIN_LISTS:
        for name, (type_name, _) in entries_of(listed.kind, server.get(listed.kind, []), listed.costmap).items():
            if type_name in types:
                kind = find_class(type_name, listed.base, listed.known)
                yield name, kind, values_of(server, name, kind)
    for costmap in COSTMAPS:
        for name, type_name, values in layer_groups(server.get(costmap, {})):
            if type_name in types:
                yield f"{costmap}.{name}", find_class(type_name, Layer, LAYERS), values
