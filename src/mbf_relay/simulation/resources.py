"""Resolves references to files in worlds and URDFs: model://, package:// and file:// URIs, and plain paths."""

from __future__ import annotations

import os
from functools import lru_cache
from pathlib import Path
from typing import List
from urllib.parse import unquote

from mbf_relay import files


class MissingResource(ValueError):
    """A file that a world refers to was not found; the text names it and where it was looked for."""

    def __init__(self, uri: str, advice: str) -> None:
        """Make the error.

        Args:
            uri: The reference as written in the world.
            advice: Where it was looked for, in brackets, and what to do.
        """
        super().__init__(f"'{uri}' was not found {advice}")
        self.uri, self.advice = uri, advice


def find_resource(uri: str, base: str) -> str:
    """Return the path of the file or folder that a URI refers to.

    Args:
        uri: model://NAME/..., package://NAME/..., file://PATH, or a path, absolute or relative to `base`.
        base: Folder of the file with the reference.

    Raises:
        MissingResource: There is no such file or folder, or the URI has another scheme.
    """
    scheme, separator, rest = uri.partition("://")
    if not separator:
        candidates = [uri if os.path.isabs(uri) else os.path.join(base, uri)]
    elif scheme == "file":
        path = unquote(rest)
        candidates = [path if os.path.isabs(path) else os.path.join(base, path)] + _in_folders(
            path, [*media_folders(base), *model_folders(base)]
        )
    elif scheme == "model":
        candidates = _in_folders(unquote(rest), model_folders(base))
        if not any(map(os.path.exists, candidates)):  # Gazebo also accepts packages as models
            candidates += filter(os.path.exists, _in_packages(unquote(rest)))
    elif scheme == "package":
        candidates = _in_packages(unquote(rest))
    else:
        raise MissingResource(uri, "here: only model://, package:// and file:// addresses are understood")
    for candidate in candidates:
        if os.path.exists(candidate):
            return candidate
    hint = {
        "model": "; set GAZEBO_MODEL_PATH to the folder that holds it, for Gazebo's own a checkout of "
        "https://github.com/osrf/gazebo_models",
        "package": "; is its package on ROS_PACKAGE_PATH?",
    }
    raise MissingResource(uri, f"(looked for {', '.join(candidates) or 'nothing'}){hint.get(scheme, '')}")


def model_folders(base: str) -> List[str]:
    """Return the folders in which models are searched.

    They are those of GAZEBO_MODEL_PATH, those that the file's ROS package exports to Gazebo, `base`, its folder
    `models` and its parent, and ~/.gazebo/models.
    """
    folders = _listed("GAZEBO_MODEL_PATH") + _exported(base, "gazebo_model_path")
    return folders + [base, os.path.join(base, "models"), os.path.dirname(base), os.path.expanduser("~/.gazebo/models")]


def media_folders(base: str) -> List[str]:
    """Return the folders in which other files are searched: GAZEBO_RESOURCE_PATH, and those that the package exports.
    """
    return _listed("GAZEBO_RESOURCE_PATH") + _exported(base, "gazebo_media_path")


def _listed(variable: str) -> List[str]:
    return [folder for folder in os.environ.get(variable, "").split(os.pathsep) if folder]


def _exported(base: str, attribute: str) -> List[str]:
    """Return the folders that the ROS package which contains `base` exports to Gazebo (<gazebo_ros> in package.xml)."""
    folder = Path(base).resolve()
    package = next((f for f in (folder, *folder.parents) if (f / "package.xml").is_file()), None)
    if package is None:
        return []
    try:
        exports = files.read_xml(str(package / "package.xml")).findall("export/gazebo_ros")
    except (ValueError, OSError):
        return []  # a broken package.xml is no error of the world
    texts = [export.get(attribute, "").replace("${prefix}", str(package)) for export in exports]
    return [path for text in texts for path in text.split(os.pathsep) if path]


def model_file(folder: str) -> str:
    """Return the SDF file of a model's folder: the last one that model.config names and that exists, else model.sdf.

    Raises:
        ValueError: There is none, or model.config is no XML.
        OSError: model.config cannot be opened.
    """
    config = os.path.join(folder, "model.config")
    if os.path.isfile(config):
        names = [element.text.strip() for element in files.read_xml(config).iter("sdf") if element.text]
        for name in reversed(names):
            if os.path.isfile(os.path.join(folder, name)):
                return os.path.join(folder, name)
    fallback = os.path.join(folder, "model.sdf")
    if os.path.isfile(fallback):
        return fallback
    raise ValueError(f"{folder} holds no model: it must have model.config or model.sdf")


def _in_folders(path: str, folders: List[str]) -> List[str]:
    return [os.path.join(folder, path) for folder in folders]


def _in_packages(path: str) -> List[str]:
    """Return candidates for the path of a package's file, PACKAGE/..., by ROS_PACKAGE_PATH."""
    package, _, inside = path.partition("/")
    candidates = []
    for folder in os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep):
        if folder and os.path.basename(os.path.normpath(folder)) == package:
            candidates.append(os.path.join(folder, inside))
        if folder:
            candidates.append(os.path.join(folder, package, inside))
            candidates.extend(_nested(folder, package, inside))
    if not any(map(os.path.exists, candidates)):
        folder = _by_manifest(package, os.environ.get("ROS_PACKAGE_PATH", ""))
        candidates += [os.path.join(folder, inside)] if folder else []
    return candidates


@lru_cache(maxsize=64)  # cached, as a robot has many meshes
def _by_manifest(package: str, path: str) -> str:
    """Return the folder of a package by the name in its package.xml, searched at any depth; empty for none."""
    for top in filter(None, path.split(os.pathsep)):
        for folder, deeper, names in os.walk(top):
            if "package.xml" not in names:
                deeper[:] = sorted(name for name in deeper if not name.startswith("."))
                continue
            deeper.clear()  # packages do not contain other packages
            try:
                name = files.read_xml(os.path.join(folder, "package.xml")).findtext("name", "")
            except (ValueError, OSError):
                continue  # unreadable: not the package that is searched
            if name.strip() == package:
                return folder
    return ""


def _nested(folder: str, package: str, inside: str) -> List[str]:
    """Return candidates one folder deeper, as in a repository with several packages."""
    try:
        children = sorted(entry.path for entry in os.scandir(folder) if entry.is_dir())
    except OSError:
        return []
    return [os.path.join(c, package, inside) for c in children if os.path.isdir(os.path.join(c, package))]
