"""Remarks on a world file: what of it is not taken, in a line for all parts with the same trouble."""

from __future__ import annotations

from typing import Dict, List, Tuple

from mbf_relay.simulation.resources import MissingResource

MOST_NAMED = 5
"""Models or files named in one remark; the others are counted."""


class Remarks:
    """Collects remarks on one world file and what it includes."""

    def __init__(self) -> None:
        self._warnings: Dict[str, List[str]] = {}
        self._left_out: Dict[str, None] = {}
        self._missing: Dict[str, Tuple[str, MissingResource]] = {}

    def warn(self, text: str, name: str = "") -> None:
        """Note a warning; one line is made for all names with the same text, in which they replace {}."""
        names = self._warnings.setdefault(text, [])
        if name not in names:
            names.append(name)

    def leave_out(self, error: ValueError, whose: str = "") -> None:
        """Note a part of the world that is left out, as it is missing or malformed; `whose` begins its line."""
        if isinstance(error, MissingResource):
            self._missing.setdefault(error.uri, (whose, error))
        else:
            self._left_out[whose + str(error)] = None

    def lost(self) -> List[str]:
        """Return a line for each part that is left out, and one on all missing files."""
        lost = list(self._left_out)
        if self._missing:
            names = _listed([f"{whose}'{error.uri}'" for whose, error in self._missing.values()])
            advice = next(iter(self._missing.values()))[1].advice
            lost.append(f"{names} {'was' if len(self._missing) == 1 else 'were'} not found {advice}")
        return lost

    def lines(self) -> List[str]:
        """Return all remarks."""
        told = [text.replace("{}", _listed(names)) for text, names in self._warnings.items()]
        return told + [f"{line}; it is left out" for line in self.lost()]


def _listed(names: List[str]) -> str:
    """Return names for a message, the first MOST_NAMED and the number of the others."""
    more = f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else ""
    return ", ".join(names[:MOST_NAMED]) + more
