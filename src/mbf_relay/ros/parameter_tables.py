"""The README's parameter tables, written from the declarations themselves, so that they cannot be out of date."""

from __future__ import annotations

import argparse
import dataclasses
import importlib
import pkgutil
import re
import sys
import typing
from typing import Any, Dict, List, Type

import mbf_relay
from mbf_relay.parameters import ParameterSet

BEGIN = "<!-- parameters: made by `rosrun mbf_relay parameter_tables.py --write README.md` -->"
END = "<!-- end of parameters -->"


def main() -> None:
    """Print the tables, or write them between their markers in a file."""
    parser = argparse.ArgumentParser(description="Print the tables of all parameters, as Markdown.")
    parser.add_argument("--write", metavar="FILE", help="replace the tables between their markers in this file")
    arguments = parser.parse_args()
    if not arguments.write:
        print(tables())
        return
    with open(arguments.write, encoding="utf-8") as stream:
        text = stream.read()
    try:
        changed = replaced(text)
    except ValueError as error:
        sys.exit(f"{arguments.write}: {error}")
    with open(arguments.write, "w", encoding="utf-8") as stream:
        stream.write(changed)


def replaced(text: str) -> str:
    """Return a document with the tables between its markers made anew; raise ValueError where there are no markers."""
    if BEGIN not in text or END not in text:
        raise ValueError(f"there is no place for the tables: it needs the lines {BEGIN} and {END}")
    head, rest = text.split(BEGIN, 1)
    return f"{head}{BEGIN}\n{tables()}\n{END}{rest.split(END, 1)[1]}"


def tables() -> str:
    """Return one folded table for each parameter set of the package."""
    return "\n".join(_table(found) for found in parameter_sets())


def parameter_sets() -> List[Type[ParameterSet]]:
    """Return every parameter set that the package declares, by module and name."""
    for module in pkgutil.walk_packages(mbf_relay.__path__, "mbf_relay."):
        if not module.name.endswith("__main__"):
            importlib.import_module(module.name)
    found: Dict[str, Type[ParameterSet]] = {}
    pending = list(ParameterSet.__subclasses__())
    while pending:
        candidate = pending.pop()
        pending.extend(candidate.__subclasses__())
        # A set that another one extends is shown there, with what the other adds.
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
    parts = [f"{words} {meta[key]:g}" for key, words in (("above", "above"), ("minimum", "at least"), ("maximum", "at most"))
             if meta.get(key) is not None]
    kinds = {bool: "true, false", int: "whole number", str: "text"}
    return ", ".join(parts) or kinds.get(hint, "")


def _meaning(meta: Any) -> str:
    older = ", ".join(f"`{name}`" for name in meta.get("aliases", ()))
    return meta.get("description", "") + (f" (older name: {older})" if older else "")
