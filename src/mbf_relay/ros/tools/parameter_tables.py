"""parameter_tables.py: make the READMEs' tables of parameters and launch arguments from their declarations."""

from __future__ import annotations

import argparse
import dataclasses
import importlib
import pkgutil
import re
import sys
import typing
from pathlib import Path
from typing import Any, Callable, Dict, List, Type
from xml.etree.ElementTree import Element

from defusedxml import ElementTree

import mbf_relay
from mbf_relay.parameters import ParameterSet


def main() -> None:
    """Print the tables, or replace those between the markers in a file."""
    parser = argparse.ArgumentParser(description="Print the tables of all parameters, as Markdown.")
    parser.add_argument("--write", metavar="FILE", help="regenerate the tables between the markers in this file")
    arguments = parser.parse_args()
    if not arguments.write:
        print(tables())
        return
    path = Path(arguments.write)
    try:
        changed = replaced(path.read_text(encoding="utf-8"), path.resolve().parent)
    except (OSError, ValueError) as error:
        sys.exit(f"{path}: {error}")
    path.write_text(changed, encoding="utf-8")


def replaced(text: str, folder: Path) -> str:
    """Return a document with the tables between its markers regenerated.

    Args:
        text: Markdown with the markers of parameters, of launch files, or of both.
        folder: Folder of the launch files.

    Raises:
        ValueError: There is no marker.
    """
    makers: Dict[str, Callable[[], str]] = {"parameters": tables, "launch files": lambda: launch_tables(folder)}
    found = False
    for name, make in makers.items():
        begin, end = (
            f"<!-- {name}: made by `rosrun mbf_relay parameter_tables.py --write FILE` -->",
            f"<!-- end of {name} -->",
        )
        if begin in text and end in text:
            found = True
            head, rest = text.split(begin, 1)
            text = f"{head}{begin}\n{make()}\n{end}{rest.split(end, 1)[1]}"
    if not found:
        raise ValueError("there is no place for the tables: it needs the two lines that mark a section")
    return text


def launch_tables(folder: Path) -> str:
    """Return a folded table of arguments for each launch file, with its first comment as the summary."""
    parts = []
    for path in sorted(folder.glob("*.launch")):
        text = path.read_text(encoding="utf-8")
        comment = re.search(r"<!--(.*?)-->", text, re.DOTALL)
        summary = " ".join(comment.group(1).split()) if comment else ""
        rows = [
            f"| `{argument.get('name')}` | {_cell(argument)} | {' '.join((argument.get('doc') or '').split())} |"
            for argument in ElementTree.fromstring(text).findall("arg") if argument.get("value") is None
        ]
        parts.append(f"<details><summary><code>{path.name}</code>: {summary}</summary>\n")
        if rows:
            parts.append("\n".join(["| argument | default | meaning |", "|---|---|---|", *rows]) + "\n")
        parts.append("</details>")
    return "\n".join(parts)


def _cell(argument: Element) -> str:
    default = argument.get("default")
    return "required" if default is None else f"`{default}`" if default else "none"


def tables() -> str:
    """Return a folded table for each parameter set of the package."""
    return "\n".join(_table(found) for found in parameter_sets())


def parameter_sets() -> List[Type[ParameterSet]]:
    """Return all parameter sets of the package, sorted by module and name.

    Modules that need a missing package cannot be imported and are skipped; none of them declares a parameter set.
    """
    for module in pkgutil.walk_packages(mbf_relay.__path__, "mbf_relay."):
        if module.name.endswith("__main__"):
            continue
        try:
            importlib.import_module(module.name)
        except ModuleNotFoundError as missing:
            if (missing.name or "").partition(".")[0] == mbf_relay.__name__:
                raise
    found: Dict[str, Type[ParameterSet]] = {}
    pending = list(ParameterSet.__subclasses__())
    while pending:
        candidate = pending.pop()
        pending.extend(candidate.__subclasses__())
        # A set with a subclass in the package is shown as part of the subclass.
        extended = any(further.__module__.startswith("mbf_relay.") for further in candidate.__subclasses__())
        if candidate.__module__.startswith("mbf_relay.") and dataclasses.fields(candidate) and not extended:
            found[f"{candidate.__module__}.{candidate.__qualname__}"] = candidate
    return [found[name] for name in sorted(found)]


def _table(parameter_set: Type[ParameterSet]) -> str:
    summary = (parameter_set.__doc__ or "").strip().splitlines()[0].rstrip(".")
    place = parameter_set.__module__.replace("mbf_relay.", "", 1)
    lines = [
        f"<details><summary>{summary} (<code>{place}.{parameter_set.__qualname__}</code>)</summary>",
        "",
        "| parameter | default | unit | allowed | meaning |",
        "|---|---|---|---|---|",
    ]
    hints = typing.get_type_hints(parameter_set)
    for field in dataclasses.fields(parameter_set):
        meta = field.metadata
        cells = (f"`{field.name}`", f"`{_default(field)}`", meta.get("unit", ""), _allowed(meta, hints[field.name]),
                 _meaning(meta))
        lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return "\n".join(lines + ["", "</details>"])


def _default(field: Any) -> str:
    if field.default is not dataclasses.MISSING:
        value = field.default
    else:
        value = field.default_factory() if field.default_factory is not dataclasses.MISSING else "required"
    if isinstance(value, bool) or value is None:
        return str(value).lower()
    if isinstance(value, float):
        return f"{value:.6g}"
    return re.sub(r"[()]", lambda bracket: "[" if bracket.group() == "(" else "]", str(value)).replace(",]", "]")


def _allowed(meta: Any, hint: Any) -> str:
    if meta.get("choices"):
        return ", ".join(f"`{choice}`" for choice in meta["choices"])
    parts = [
        f"{words} {meta[key]:g}"
        for key, words in (("above", "above"), ("minimum", "at least"), ("maximum", "at most"))
        if meta.get(key) is not None
    ]
    kinds = {bool: "true, false", int: "whole number", str: "text"}
    return ", ".join(parts) or kinds.get(hint, "")


def _meaning(meta: Any) -> str:
    description, older = str(meta.get("description", "")), ", ".join(f"`{name}`" for name in meta.get("aliases", ()))
    return description + (f" (older name: {older})" if older else "")
