"""Substitution of $(…) in launch files, as by roslaunch, on a machine that may lack some of the robot's packages."""

from __future__ import annotations

import contextlib
import os
import re
from functools import lru_cache
from pathlib import Path
from typing import Dict, FrozenSet, Mapping, Optional

from roslaunch.substitution_args import ArgException, resolve_args
from rospkg import ResourceNotFound, RosPack

from mbf_relay import files

FIND = re.compile(r"\$\(find\s+([\w.-]+)\s*\)")


class Substitution:
    """Resolves the texts of one launch file, and holds its arguments.

    Packages are searched in ROS_PACKAGE_PATH, then in the repository of the file, which need not be in a workspace. An
    argument whose value cannot be resolved, such as a map in a missing package, is an error only where it is used.
    """

    def __init__(self, path: str, arguments: Optional[Mapping[str, str]] = None) -> None:
        """Start with the arguments given from outside.

        Args:
            path: The launch file.
            arguments: Values by name.
        """
        self._path, self._values = path, dict(arguments or {})
        self._unresolved: Dict[str, str] = {}

    def knows(self, name: str) -> bool:
        """Return whether an argument was given, also one that cannot be resolved."""
        return name in self._values or name in self._unresolved

    def give(self, name: str, text: str, within: Substitution) -> None:
        """Set an argument to a text of a file whose substitution is `within`."""
        try:
            self._values[name] = within.resolved(text)
        except ValueError as error:
            self._unresolved[name] = str(error)

    def give_all(self, within: Substitution) -> None:
        """Set all arguments of `within`, as by pass_all_args."""
        self._values.update(within._values)
        self._unresolved.update(within._unresolved)

    def resolved(self, text: str) -> str:
        """Return a text with each $(…) replaced by its value.

        Raises:
            ValueError: An argument, a package or an expression cannot be resolved; the text names it and the file.
        """
        context = {"arg": self._values, "filename": self._path}
        try:
            return str(resolve_args(FIND.sub(self._package, text), context, resolve_anon=True))
        except ArgException as error:
            name = str(error)
            reason = self._unresolved.get(name)
            raise ValueError(reason or f"{self._path}: the argument {name} has no value; give --arg {name}:=VALUE, or "
                             "check the launch file that includes this one") from error
        except ResourceNotFound as error:
            raise ValueError(f"{text}: there is no package {error.args[0]} in ROS_PACKAGE_PATH or beside "
                             f"{self._path}") from error
        except Exception as error:  # $(eval …) may raise anything
            raise ValueError(f"{self._path}: {text!r} cannot be resolved: {error}") from error

    def _package(self, find: re.Match[str]) -> str:
        """Return the folder of a package that only the repository has; of any other, $(find …) unchanged."""
        name = find.group(1)
        if name in _known_to_ros():
            return find.group(0)
        return _packages_below(str(_repository(Path(self._path).resolve()))).get(name, find.group(0))


def _repository(path: Path) -> Path:
    """Return the root of a file's Git checkout; without one, the parent folder of its package, else its own folder."""
    for folder in path.parents:
        if (folder / ".git").exists():
            return folder
    for folder in path.parents:
        if (folder / "package.xml").exists():
            return folder.parent
    return path.parent


@lru_cache(maxsize=None)
def _known_to_ros() -> FrozenSet[str]:
    """Return the names of the packages in ROS_PACKAGE_PATH."""
    return frozenset(RosPack().list())


@lru_cache(maxsize=None)
def _packages_below(folder: str) -> Dict[str, str]:
    """Return the packages' folders below a folder, by package name; skip those whose package.xml cannot be read."""
    found: Dict[str, str] = {}
    for path, folders, names in os.walk(folder):
        if "CATKIN_IGNORE" in names or ".catkin" in names:  # devel and install spaces have a .catkin
            folders.clear()
        elif "package.xml" in names:
            folders.clear()
            with contextlib.suppress(ValueError, OSError):
                found.setdefault((files.read_xml(f"{path}/package.xml").findtext("name") or "").strip(), path)
        elif "manifest.xml" in names:  # a rosbuild package is named after its folder
            folders.clear()
            found.setdefault(os.path.basename(path), path)
        folders[:] = sorted(name for name in folders if not name.startswith("."))
    return found
