"""A screen without a monitor, RViz on it, and a hand on its mouse: what tests need to click as a person does."""

import math
import os
import subprocess
import tempfile
from typing import Dict, List, Sequence, Tuple

from ros_testing import wait_until

WIDTH, HEIGHT = 1400, 960


class VirtualScreen:
    """An X server on a free display; a context manager that ends what it started."""

    def __init__(self) -> None:
        self._processes: List[subprocess.Popen] = []
        self.environment: Dict[str, str] = {}

    def __enter__(self) -> "VirtualScreen":
        reading, writing = os.pipe()
        self._processes.append(
            subprocess.Popen(
                ["Xvfb", "-displayfd", str(writing), "-screen", "0", f"{WIDTH}x{HEIGHT}x24", "-nolisten", "tcp"],
                pass_fds=[writing], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
            )
        )
        os.close(writing)
        with os.fdopen(reading) as stream:
            display = stream.readline().strip()
        if not display:
            raise RuntimeError("Xvfb did not start; is the package xvfb installed?")
        self._home = tempfile.TemporaryDirectory()
        # Without a graphics card a core draws; no test looks at the smooth edges that take four samples of a pixel.
        self.environment = dict(
            os.environ, DISPLAY=f":{display}", LIBGL_ALWAYS_SOFTWARE="1", DRI_NO_MSAA="1", HOME=self._home.name,
            XDG_RUNTIME_DIR=self._home.name,
        )
        return self

    def __exit__(self, *_: object) -> None:
        for process in reversed(self._processes):
            process.terminate()
        for process in self._processes:
            try:
                process.wait(10.0)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
        self._home.cleanup()

    def start(self, command: List[str], log: str) -> subprocess.Popen:
        """Start a program on this screen, its output in the file `log`."""
        with open(log, "wb") as stream:
            process = subprocess.Popen(command, env=self.environment, stdout=stream, stderr=subprocess.STDOUT)
        self._processes.append(process)
        return process

    def xdotool(self, *arguments: object) -> str:
        """Run xdotool and return what it prints."""
        command = ["xdotool"] + [str(argument) for argument in arguments]
        run = subprocess.run(command, env=self.environment, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
        return run.stdout.decode()

    def screenshot(self, path: str) -> None:
        """Write what the screen shows as PNG."""
        subprocess.run(["import", "-window", "root", path], env=self.environment, check=True)


class RViz:
    """RViz on a virtual screen, seen from straight above at a known scale; `command` starts it if not `rviz` itself."""

    def __init__(
        self, screen: VirtualScreen, config: str, log: str, scale: float = 110.0, command: Sequence[str] = ()
    ) -> None:
        self.screen = screen
        self.scale = scale
        self._name = os.path.basename(config)
        self._view: Tuple[int, int, int, int] = (0, 0, 0, 0)
        for _attempt in range(4):
            # On a screen without a graphics card RViz itself now and then aborts while it starts.
            self.process = screen.start(list(command) or ["rviz", "-d", config, "__name:=rviz"], log)
            ended = wait_until(
                lambda: self._has_settled() or self.process.poll() is not None, "RViz's 3D view", 60.0, 1.0
            )
            if self.process.poll() is None and ended:
                return
        raise AssertionError(f"rviz ended with status {self.process.returncode} each time before it showed anything")

    def drag(self, key: str, x: float, y: float, heading: float) -> None:
        """Take the tool with a shortcut key, press at a map position (m), drag towards `heading` (rad), release."""
        column, row = self.pixel(x, y)
        # As slowly as a hand: a renderer without a graphics card draws a few frames a second, and a tool that is not
        # yet taken, or a drag between two frames, counts for nothing.
        pause = ("sleep", 0.15)
        moves = [
            ("mousemove", round(column + reach * math.cos(heading)), round(row - reach * math.sin(heading)), *pause)
            for reach in (20, 40, 60, 80)
        ]
        steps = [
            ("mousemove", column, row, *pause),
            # A tool's key pressed again puts the tool back: whoever tries a second time starts without one.
            ("key", "Escape", *pause),
            ("key", key, *pause),
            ("mousedown", 1, *pause),
            *moves,
            ("mouseup", 1),
        ]
        self.screen.xdotool(*(word for step in steps for word in step))

    def pixel(self, x: float, y: float) -> Tuple[float, float]:
        """Return the screen position of a map position (m)."""
        left, top, width, height = self._view
        return round(left + width / 2.0 + self.scale * x), round(top + height / 2.0 - self.scale * y)

    def _has_settled(self) -> bool:
        # RViz shows itself before it has read its file and laid out its panels: the view counts once it stays put.
        before, self._view = self._view, self._find_view()
        return bool(self.screen.xdotool("search", "--name", self._name)) and self._view[2] > 0 and self._view == before

    def _find_view(self) -> Tuple[int, int, int, int]:
        # The renderer draws into a window of its own, without a name, inside the main window.
        # Windows are listed from the outside in, so it is the last large one.
        for window in reversed(self.screen.xdotool("search", "--name", "^$").split()):
            lines = self.screen.xdotool("getwindowgeometry", "--shell", window).split()
            box = dict(line.split("=", 1) for line in lines if "=" in line)
            if 500 < int(box.get("WIDTH", 0)) < WIDTH and int(box.get("HEIGHT", 0)) > 500:
                return int(box["X"]), int(box["Y"]), int(box["WIDTH"]), int(box["HEIGHT"])
        return 0, 0, 0, 0
