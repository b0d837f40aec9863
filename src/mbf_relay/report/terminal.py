"""Output of a drive on a terminal: a line updated while a goal runs, a line for each goal's end, a final table."""

from __future__ import annotations

from typing import IO, Any, List, Mapping, Optional, Sequence

from mbf_relay.report.drive import Drive, GoalRecord

GREEN, RED, DIM, PLAIN = "\033[32m", "\033[31m", "\033[2m", "\033[0m"
ERASE_LINE = "\r\033[K"


class Terminal:
    """Writes the progress of a drive.

    Where the stream is no terminal, or a dumb one, there are no updated line and no colours; no colours either where
    the environment has NO_COLOR (no-color.org).

    Args:
        stream: Where to write.
        goals: Number of goals, None where not known.
        environment: The process' environment variables.
    """

    def __init__(self, stream: IO[str], goals: Optional[int], environment: Mapping[str, str]) -> None:
        self._stream = stream
        self._goals = goals
        self._live = bool(getattr(stream, "isatty", lambda: False)()) and environment.get("TERM") != "dumb"
        self._coloured = self._live and not environment.get("NO_COLOR")
        self._shown = False

    def progress(self, number: int, distance: Optional[float], speed: float, seconds: float, recoveries: int) -> None:
        """Show the progress of a goal: its number, distance left (m), speed (m/s), time (s) and recoveries."""
        if self._live:
            left = "  planning" if distance is None else f"{distance:5.2f} m left"
            behaviours = f"  {recoveries} recoveries" if recoveries else ""
            text = f"{self._name(number)}  {left}  {speed:5.2f} m/s  {seconds:5.1f} s{behaviours}"
            self._stream.write(ERASE_LINE + self._paint(text, DIM))
            self._stream.flush()
            self._shown = True

    def ended(self, number: int, goal: GoalRecord) -> None:
        """Write the line of a goal that has ended."""
        seconds = 0.0 if goal.ended is None else goal.ended - goal.started
        words = (
            self._paint("reached", GREEN) if goal.reached else self._paint(f"{goal.state.lower()}: {goal.text}", RED)
        )
        recovered = f", after {', '.join(goal.recoveries)}" if goal.recoveries else ""
        self.line(f"{self._name(number)}  {words} in {seconds:.1f} s{recovered}")

    def line(self, text: str) -> None:
        """Write a line in place of the updated one."""
        self._stream.write(f"{ERASE_LINE if self._shown else ''}{text}\n")
        self._stream.flush()
        self._shown = False

    def table(self, drive: Drive) -> None:
        """Write the final table."""
        figures = drive.summary()
        rows: List[Sequence[Any]] = [
            ("goals reached", f"{figures['goals_reached']} of {figures['goals_asked']}"),
            ("contacts", figures["contacts"]),
            ("recoveries", figures["recoveries"]),
            ("driven", f"{figures['path_length']:.2f} m"),
            ("time", f"{figures['sim_time']:.1f} s"),
        ]
        if figures["wall_time"] is not None:
            rows.append(("on the wall clock", f"{figures['wall_time']:.1f} s"))
        if figures["localization_error_mean"] is not None:
            mean, largest = figures["localization_error_mean"], figures["localization_error_max"]
            rows.append(("localization error", f"{100 * mean:.1f} cm mean, {100 * largest:.1f} cm at most"))
        width = max(len(name) for name, _ in rows)
        self.line("")
        for name, value in rows:
            self.line(f"  {name:<{width}}  {value}")
        verdict = ("clean drive", GREEN) if figures["success"] else ("not a clean drive", RED)
        self.line(f"  {'result':<{width}}  {self._paint(*verdict)}")

    def _name(self, number: int) -> str:
        return f"goal {number}" + (f" of {self._goals}" if self._goals else "")

    def _paint(self, text: str, colour: str) -> str:
        return f"{colour}{text}{PLAIN}" if self._coloured else text
