"""What reconfiguring offers here beside what it offers of upstream's nodes, and the README's table of the differences.

`python3 -m upstream_parameters` in this folder writes the table.
"""

import contextlib
import sys
import types
from pathlib import Path
from unittest import mock

from benchmark.report import rewrite_section

from mbf_relay import files

TEST = Path(__file__).resolve().parent
CONFIG = TEST.parent / "config"
README = TEST.parent / "launch" / "README.md"
UPSTREAM = files.parse_yaml((TEST / "unit" / "ros" / "common" / "upstream_cfg.yaml").read_text(encoding="utf-8"))
DIFFERENT = UPSTREAM.pop("differences")
"""By server and parameter: the type or the slider's end that is another here, and why."""
SECTION = ("<!-- reconfigure: made by `python3 -m upstream_parameters` in test/ -->", "<!-- end of reconfigure -->")
ENDS = {"low": "from", "high": "to", "type": "of type"}


class Generator:
    """Stands in for dynamic_reconfigure's, and keeps what a .cfg file adds."""

    def __init__(self):
        self.found = {}

    def const(self, name, kind, value, description):
        return value

    def enum(self, constants, description):
        return constants

    def add(self, name, kind, level, description, default=None, min=None, max=None, edit_method=""):
        self.found[name] = (kind, default, min, max)

    def generate(self, *names):
        return 0


def offered(name):
    """Return what a .cfg file of ours offers: type, default, least and greatest value by name."""
    made = []
    module = types.ModuleType("dynamic_reconfigure.parameter_generator_catkin")
    module.ParameterGenerator = lambda: made.append(Generator()) or made[-1]
    for kind in ("bool", "int", "double", "str"):
        setattr(module, f"{kind}_t", kind)
    path = CONFIG / f"{name}.cfg"
    ours = {"dynamic_reconfigure": types.ModuleType("dynamic_reconfigure"), module.__name__: module}
    with mock.patch.dict(sys.modules, ours), contextlib.suppress(SystemExit):
        exec(compile(path.read_text(encoding="utf-8"), str(path), "exec"), {"__file__": str(path)})
    (generator,) = made
    return generator.found


def table():
    """Return the README's rows: how many of upstream's names are here, how many are only here, and what differs."""
    lines = ["| offered | names of C++'s here | only here | where not alike |", "|---|---|---|---|"]
    for name, theirs in UPSTREAM.items():
        ours = offered(name)
        reasons = {}
        for parameter, difference in DIFFERENT.get(name, {}).items():
            (end,) = set(difference) & set(ENDS)
            told = f"{ENDS[end]} {difference[end]} ({difference['why']})"
            reasons.setdefault(told, []).append(f"`{parameter}`")
        unlike = "; ".join(f"{', '.join(names)} {told}" for told, names in reasons.items())
        here = len(set(theirs) & set(ours))
        lines.append(f"| {name} | {here} of {len(theirs)} | {len(set(ours) - set(theirs))} | {unlike or 'none'} |")
    return "\n".join(lines)


if __name__ == "__main__":
    README.write_text(rewrite_section(README.read_text(encoding="utf-8"), SECTION, table()), encoding="utf-8")
