"""The README's section of figures: those a newcomer asks for first, then all of them, folded by benchmark."""

from __future__ import annotations

from typing import Any, Dict, List, NamedTuple, Sequence, Tuple

from mbf_relay.benchmarks.figure import Figure, machine_line, round_for_people, table

MARKER_BEGIN = "<!-- benchmark: made by `rosrun mbf_relay benchmark.py --readme` -->"
MARKER_END = "<!-- end of benchmark -->"

Results = Sequence[Tuple[str, Figure]]


class Headline(NamedTuple):
    """One line of the short table: what it says, and the figure that says it.

    Attributes:
        text: What the figure means to somebody who has not read the benchmark.
        benchmark: Its benchmark's name.
        figure: Its name.
        where: Parameters that tell it from others of that name.
        of: The parameter that says out of how many it is; empty where it is no count.
    """

    text: str
    benchmark: str
    figure: str
    where: Dict[str, Any] = {}
    of: str = ""

    def fits(self, benchmark: str, figure: Figure) -> bool:
        """Tell whether a figure is the one meant."""
        here = (benchmark, figure.name) == (self.benchmark, self.figure)
        return here and all(figure.parameters.get(name) == value for name, value in self.where.items())


DWA = {"controller": "DWAPlannerROS"}
HEADLINES = (
    Headline(
        "the tutorial's circle: drives that reached all eight goals without a touch", "circle",
        "circles with all goals reached and no contact", of="seeds",
    ),
    Headline("time of a circle", "circle", "time"),
    Headline("clearance to the nearest surface, smallest of a circle", "circle", "smallest clearance"),
    Headline("localization error on the circle, mean", "localization", "circle: position error, mean"),
    Headline("localization error on the circle, largest", "localization", "circle: position error, max"),
    Headline("robot carried off: found again", "localization", "kidnapping: found"),
    Headline("obstacle fields of the BARN challenge driven through", "worlds", "worlds driven to the goal", DWA, of="worlds"),
    Headline("contacts there", "worlds", "contacts", DWA),
    Headline("first velocity of the server after a goal", "server", "goal to first velocity"),
    Headline("idle server, share of a core", "server", "idle server, share of one core"),
    Headline("goal handed on by the relay", "relay", "goal through the relay"),
    Headline("cancel handed on by the relay", "relay", "cancel through the relay"),
    Headline("idle relay, share of a core", "relay", "idle relay, share of one core"),
    Headline("a plan on a map of 384 x 384 cells", "planning", "plan 384 x 384, navfn"),
    Headline("a plan on a map of 3840 x 3840 cells", "planning", "plan 3840 x 3840, navfn"),
    Headline("one cycle of DWA, 20 x 40 velocities", "control", "one cycle of DWA", {"sampled": "20 x 40", "turn": 0.0}),
    Headline("one update of the local costmap, scan and inflation", "costmap", "update of the local costmap"),
    Headline("one update of the particle filter, 3000 particles, 180 beams", "localization", "whole update, robust"),
    Headline("simulation alone, times real time, one core", "simulation", "real time factor, driving", {"world": "arena"}),
    Headline("whole stack without ROS, times real time, one core", "circle", "real-time factor on one core"),
    Headline("circles driven per minute, without ROS", "circle", "circles per minute"),
)


def rewrite_section(readme: str, machine: Dict[str, Any], results: Results) -> str:
    """Return the README's text with what is between its two markers made anew.

    Raises:
        ValueError: The README lacks the markers, or a headline's figure is not among its benchmark's.
    """
    before, begin, rest = readme.partition(MARKER_BEGIN)
    _, end, after = rest.partition(MARKER_END)
    if not (begin and end):
        raise ValueError(f"the README has no section between '{MARKER_BEGIN}' and '{MARKER_END}'; add these two lines")
    parts = [machine_line(machine), headline_table(results)]
    for benchmark in dict.fromkeys(name for name, _ in results):
        figures = [figure for name, figure in results if name == benchmark]
        parts.append(
            f"<details><summary>All figures of <code>benchmark.py {benchmark}</code></summary>\n\n{table(figures)}\n\n</details>"
        )
    return f"{before}{begin}\n" + "\n\n".join(parts) + f"\n{end}{after}"


def headline_table(results: Results) -> str:
    """Return the short table as Markdown; benchmarks that were not run are left out of it.

    Raises:
        ValueError: A benchmark was run, and has no figure a headline names, or several.
    """
    ran = {name for name, _ in results}
    lines: List[str] = ["| what | figure |", "|---|---|"]
    for headline in HEADLINES:
        if headline.benchmark not in ran:
            continue
        found = [figure for name, figure in results if headline.fits(name, figure)]
        if len(found) != 1:
            raise ValueError(
                f"{len(found)} figures of {headline.benchmark} are '{headline.figure}' with {headline.where}; a headline names one"
            )
        words = [round_for_people(found[0].value), found[0].unit]
        if headline.of:
            words += ["of", str(found[0].parameters[headline.of])]
        lines.append(f"| {headline.text} | {' '.join(word for word in words if word)} |")
    return "\n".join(lines)
