"""The package's executables, for tests that start them."""

from pathlib import Path

FOLDER = Path(__file__).resolve().parents[1] / "scripts"


def program(name: str) -> str:
    """Return where an executable is; rosrun, which the READMEs' commands try, looks for it for half a second of a core.
    """
    return str(FOLDER / name)
