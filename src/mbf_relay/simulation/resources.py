"""Files that worlds refer to: model://, package:// and file:// addresses, and plain paths."""

from __future__ import annotations

import os
from typing import List
from urllib.parse import unquote

from mbf_relay import files


class MissingResource(ValueError):
    """A file that a world refers to is not there; the text names it and where it was looked for."""


def find_resource(uri: str, base: str) -> str:
    """Return the path that an address means.

    Args:
        uri: model://NAME/..., package://NAME/..., file://PATH, or a path, absolute or relative to `base`.
        base: Folder of the file that refers to it.

    Raises:
        MissingResource: There is no such file or folder.
    """
    scheme, separator, rest = uri.partition("://")
    if not separator:
        candidates = [uri if os.path.isabs(uri) else os.path.join(base, uri)]
    elif scheme == "file":
        path = unquote(rest)
        candidates = [path if os.path.isabs(path) else os.path.join(base, path)] + _in_folders(
            path, model_folders(base)
        )
    elif scheme == "model":
        candidates = _in_folders(unquote(rest), model_folders(base))
    elif scheme == "package":
        candidates = _in_packages(unquote(rest))
    else:
        raise MissingResource(f"'{uri}' cannot be read: only model://, package:// and file:// addresses are understood")
    for candidate in candidates:
        if os.path.exists(candidate):
            return candidate
    hint = {
        "model": "; set GAZEBO_MODEL_PATH to the folder that holds it",
        "package": "; is its package on ROS_PACKAGE_PATH?",
    }
    raise MissingResource(
        f"'{uri}' was not found (looked for {', '.join(candidates) or 'nothing'}){hint.get(scheme, '')}"
    )


def model_folders(base: str) -> List[str]:
    """Return the folders models are looked for in: GAZEBO_MODEL_PATH, beside the file, ~/.gazebo/models."""
    folders = [folder for folder in os.environ.get("GAZEBO_MODEL_PATH", "").split(os.pathsep) if folder]
    return folders + [base, os.path.join(base, "models"), os.path.dirname(base), os.path.expanduser("~/.gazebo/models")]


def model_file(folder: str) -> str:
    """Return the SDF file of a model's folder, which its model.config names.

    Raises:
        MissingResource: It has none.
    """
    config = os.path.join(folder, "model.config")
    if os.path.isfile(config):
        try:
            names = [element.text.strip() for element in files.read_xml(config).iter("sdf") if element.text]
        except ValueError as error:
            raise MissingResource(str(error)) from error
        for name in reversed(names):
            if os.path.isfile(os.path.join(folder, name)):
                return os.path.join(folder, name)
    fallback = os.path.join(folder, "model.sdf")
    if os.path.isfile(fallback):
        return fallback
    raise MissingResource(f"{folder} holds no model: it must have model.config or model.sdf")


def _in_folders(path: str, folders: List[str]) -> List[str]:
    return [os.path.join(folder, path) for folder in folders]


def _in_packages(path: str) -> List[str]:
    """Return where a package's file may be: the package's folder itself, or in a folder of packages."""
    package, _, inside = path.partition("/")
    candidates = []
    for folder in os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep):
        if folder and os.path.basename(os.path.normpath(folder)) == package:
            candidates.append(os.path.join(folder, inside))
        if folder:
            candidates.append(os.path.join(folder, package, inside))
            candidates.extend(_nested(folder, package, inside))
    return candidates


def _nested(folder: str, package: str, inside: str) -> List[str]:
    """Return a package's file one folder deeper, as in a repository of several packages."""
    try:
        children = sorted(entry.path for entry in os.scandir(folder) if entry.is_dir())
    except OSError:
        return []
    return [os.path.join(c, package, inside) for c in children if os.path.isdir(os.path.join(c, package))]
