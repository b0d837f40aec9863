"""Makes mbf_msgs as its release 0.4.0 has it, which is what Noetic installs, from the definitions in action/.

The release has fewer outcomes, so most have other numbers, no use_padded_fp and no FindValidPose.
"""

import re
import sys
from pathlib import Path
from typing import Iterator

import rospkg
from genpy.generate_initpy import write_modules
from genpy.generator import MsgGenerator, SrvGenerator

ACTION_FOLDER = Path(__file__).resolve().parents[1] / "action"
CAME_LATER = {
    "GetPath": ("BLOCKED_START", "BLOCKED_GOAL"), "ExePath": ("BLOCKED_GOAL",),
    "CheckPose": ("use_padded_fp",), "CheckPath": ("use_padded_fp",),
}
SERVICES = ("CheckPoint", "CheckPose", "CheckPath")
WRAPPERS = {
    "ActionGoal": "Header header\nactionlib_msgs/GoalID goal_id\n{0}Goal goal\n",
    "ActionResult": "Header header\nactionlib_msgs/GoalStatus status\n{0}Result result\n",
    "ActionFeedback": "Header header\nactionlib_msgs/GoalStatus status\n{0}Feedback feedback\n",
    "Action": "{0}ActionGoal action_goal\n{0}ActionResult action_result\n{0}ActionFeedback action_feedback\n",
}


def make(folder: Path) -> None:
    """Write a Python package mbf_msgs into a folder.

    Raises:
        RuntimeError: A definition could not be turned into Python.
    """
    sources = folder / "definitions"
    sources.mkdir()
    messages = [path for action in sorted(ACTION_FOLDER.glob("action/*.action")) for path in _split(action, sources)]
    services = [_write(sources / f"{name}.srv", _older(ACTION_FOLDER / "srv" / f"{name}.srv")) for name in SERVICES]
    found = rospkg.RosPack()
    search_path = {
        name: [str(Path(found.get_path(name)) / "msg")]
        for name in ("actionlib_msgs", "geometry_msgs", "nav_msgs", "std_msgs")
    }
    search_path["mbf_msgs"] = [str(sources)]
    for generator, kind, paths in ((MsgGenerator(), "msg", messages), (SrvGenerator(), "srv", services)):
        package = folder / "mbf_msgs" / kind
        package.mkdir(parents=True)
        if generator.generate_messages("mbf_msgs", paths, str(package), search_path):
            raise RuntimeError(f"genpy made nothing of {paths}")
        write_modules(str(package))
    (folder / "mbf_msgs" / "__init__.py").touch()


def _older(path: Path) -> str:
    """Return a definition without what came later; the outcomes behind a missing one move up."""
    lines = []
    missing = 0
    for line in path.read_text(encoding="utf-8").splitlines():
        words = re.match(r"(\w+) (\w+)( = (\d+))?$", line)
        if words and ("RANGE" in words.group(2) or words.group(2) in CAME_LATER.get(path.stem, ())):
            missing += bool(words.group(3)) and "RANGE" not in line
        elif words and words.group(3):
            lines.append(f"{words.group(1)} {words.group(2)}={int(words.group(4)) - missing}")
        else:
            lines.append(line)
    return "\n".join(lines) + "\n"


def _split(action: Path, folder: Path) -> Iterator[str]:
    """Write an action's seven messages and yield their paths."""
    parts = dict(zip(("Goal", "Result", "Feedback"), _older(action).split("---\n")))
    parts.update({name: text.format(action.stem) for name, text in WRAPPERS.items()})
    for name, text in parts.items():
        yield _write(folder / f"{action.stem}{name}.msg", text)


def _write(path: Path, text: str) -> str:
    path.write_text(text, encoding="utf-8")
    return str(path)


if __name__ == "__main__":
    make(Path(sys.argv[1]))
