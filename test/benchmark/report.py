"""The metrics in the READMEs: those a newcomer asks for in the repository's, all of them in this folder's.

What the proofs tried and lost has a section of its own in both, for it is seldom taken together with the rest, and the
public robots one in this folder's, for a row of theirs is of words.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Dict, List, NamedTuple, Sequence, Tuple

from benchmark.metric import Metric, machine_line, round_for_people, table

FIGURES = ("<!-- made by `scripts/benchmark --write` -->", "<!-- end of benchmark -->")
PROOFS = ("<!-- made by `scripts/benchmark reliability --write` -->", "<!-- end of reliability -->")
ROBOTS = ("<!-- made by `scripts/benchmark zoo --write` -->", "<!-- end of zoo -->")
"""Lines between which a README has a section."""
LOST = ", lost"
"""End of the name of a metric that counts what a proof lost."""
FEW = 10
"""Trials of which the short table says nothing where none was lost: they prove little."""

HERE = Path(__file__).resolve().parent

Results = Sequence[Tuple[str, Metric]]


class Headline(NamedTuple):
    """One line of the short table: what it says, and the metric that says it.

    Attributes:
        text: What the metric means to somebody who has not read the benchmark.
        benchmark: Its benchmark's name.
        metric: Its name.
        where: Parameters that tell it from others of that name.
        of: The parameter that says out of how many it is; empty where it is no count.
    """

    text: str
    benchmark: str
    metric: str
    where: Dict[str, Any] = {}
    of: str = ""

    def fits(self, benchmark: str, metric: Metric) -> bool:
        """Return whether a metric is the one meant."""
        here = (benchmark, metric.name) == (self.benchmark, self.metric)
        return here and all(metric.parameters.get(name) == value for name, value in self.where.items())


DWA = {"controller": "DWAPlannerROS"}
HEADLINES = (
    Headline(
        "the tutorial's circle: drives that reached all eight goals without a touch",
        "circle",
        "circles with all goals reached and no contact",
        of="seeds",
    ),
    Headline("time of a circle", "circle", "time"),
    Headline("clearance to the nearest surface, smallest of a circle", "circle", "smallest clearance"),
    Headline("localization error on the circle, mean", "localization", "circle: position error, mean"),
    Headline("localization error on the circle, largest", "localization", "circle: position error, max"),
    Headline("robot carried off: found again", "localization", "kidnapping: found"),
    Headline(
        "obstacle fields of the BARN challenge driven through", "worlds", "worlds driven to the goal", DWA, of="worlds"
    ),
    Headline("contacts there", "worlds", "contacts", DWA),
    Headline("first velocity of the server after a goal", "server", "goal to first velocity"),
    Headline("idle server, share of a core", "server", "idle server, share of one core"),
    Headline("goal handed on by the relay", "relay", "goal through the relay"),
    Headline("cancel handed on by the relay", "relay", "cancel through the relay"),
    Headline("idle relay, share of a core", "relay", "idle relay, share of one core"),
    Headline("a plan on a map of 384 x 384 cells", "planning", "plan 384 x 384, navfn"),
    Headline("a plan on a map of 3840 x 3840 cells", "planning", "plan 3840 x 3840, navfn"),
    Headline(
        "one cycle of DWA, 20 x 40 velocities", "control", "one cycle of DWA", {"sampled": "20 x 40", "turn": 0.0}
    ),
    Headline("one update of the local costmap, scan and inflation", "costmap", "update of the local costmap"),
    Headline("one update of the particle filter, 3000 particles, 180 beams", "localization", "whole update, robust"),
    Headline(
        "simulation alone, times real time, one core", "simulation", "real time factor, driving", {"world": "arena"}
    ),
    Headline("whole stack without ROS, times real time, one core", "circle", "real-time factor on one core"),
    Headline("circles driven per minute, without ROS", "circle", "circles per minute"),
)


def write_sections(machine: Dict[str, Any], results: Results) -> List[Path]:
    """Write the headlines into the repository's README.md and every metric into this folder's; return what was written.

    A section none of whose benchmarks was run stays as it is.

    Raises:
        ValueError: A README lacks the markers, or a headline's metric is not among its benchmark's.
    """
    own = {name: [result for result in results if result[0] == name] for name in ("reliability", "zoo")}
    figures = [result for result in results if result[0] not in own]
    short, whole = HERE.parents[1] / "README.md", HERE / "README.md"
    tables = []
    if any(name != "yardstick" for name, _ in figures):
        tables += [(short, FIGURES, headline_table(figures)), (whole, FIGURES, whole_tables(figures))]
    if own["reliability"]:
        proofs = own["reliability"]
        tables += [(short, PROOFS, proof_table(proofs)), (whole, PROOFS, whole_tables(proofs))]
    if own["zoo"]:
        tables += [(whole, ROBOTS, robot_table(own["zoo"]))]
    for path, markers, text in tables:
        made = rewrite_section(path.read_text(encoding="utf-8"), markers, f"{machine_line(machine)}\n\n{text}")
        path.write_text(made, encoding="utf-8")
    return list(dict.fromkeys(path for path, _, _ in tables))


def rewrite_section(readme: str, markers: Tuple[str, str], text: str) -> str:
    """Return a README with `text` between two markers.

    Raises:
        ValueError: It lacks the markers.
    """
    before, begin, rest = readme.partition(markers[0])
    _, end, after = rest.partition(markers[1])
    if not (begin and end):
        raise ValueError(f"the README has no section between '{markers[0]}' and '{markers[1]}'; add these two lines")
    return f"{before}{begin}\n{text}\n{end}{after}"


def whole_tables(results: Results) -> str:
    """Return one Markdown table a benchmark."""
    parts = []
    for benchmark in dict.fromkeys(name for name, _ in results):
        parts.append(f"### {benchmark}\n\n{table([metric for name, metric in results if name == benchmark])}")
    return "\n\n".join(parts)


def headline_table(results: Results) -> str:
    """Return the short table as Markdown; benchmarks that were not run are left out of it.

    Raises:
        ValueError: A benchmark was run, and has no metric a headline names, or several.
    """
    ran = {name for name, _ in results}
    lines: List[str] = ["| what | metric |", "|---|---|"]
    for headline in HEADLINES:
        if headline.benchmark not in ran:
            continue
        found = [metric for name, metric in results if headline.fits(name, metric)]
        if len(found) != 1:
            raise ValueError(
                f"{len(found)} metrics of {headline.benchmark} are '{headline.metric}' with {headline.where}; a "
                "headline names one"
            )
        words = [round_for_people(found[0].value), found[0].unit]
        if headline.of:
            words += ["of", str(found[0].parameters[headline.of])]
        lines.append(f"| {headline.text} | {' '.join(word for word in words if word)} |")
    return "\n".join(lines)


def proof_table(results: Results) -> str:
    """Return what was tried how often, and how much of it was lost, as Markdown; of a FEW only where some was lost."""
    lines = ["| what was tried | how often | lost |", "|---|---|---|"]
    for _, metric in results:
        if metric.name.endswith(LOST) and (metric.repeats > FEW or metric.value > 0.0):
            lines.append(f"| {metric.name[:-len(LOST)]} | {metric.repeats} | {round_for_people(metric.value)} |")
    return "\n".join(lines)


def robot_table(results: Results) -> str:
    """Return a row for each public robot: what its metric depends on, and how long it took; as Markdown."""
    robots = [metric for _, metric in results]
    columns = list(robots[0].parameters)
    lines = [f"| robot | {' | '.join(columns)} | time [s] |", "|---" * (len(columns) + 2) + "|"]
    for robot in robots:
        cells = [robot.name, *(str(robot.parameters[column]) for column in columns), f"{robot.value:.1f}"]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)
