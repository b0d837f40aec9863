"""Recording a drive with rosbag, on and off from a browser."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import time
from typing import List, Optional

from mbf_relay.ros.common.ending import become_another_program

TOPICS = (
    "/tf",
    "/tf_static",
    "/clock",
    "map",
    "odom",
    "scan",
    "cmd_vel",
    "ground_truth",
    "contacts",
    "initialpose",
    "move_base/goal",
    "move_base/result",
    "move_base/cancel",
    "move_base/recovery_status",
    "move_base_flex/move_base/goal",
    "move_base_flex/move_base/result",
    "move_base_flex/exe_path/goal",
    "move_base_flex/exe_path/result",
)
"""What drive_report.py needs, and what a person did; those without a slash are the robot's own."""
PLANS = "move_base(_flex)?/[^/]+/plan"
END_PATIENCE = 5.0
LEAST_SPACE = 1 << 30
"""Bytes that rosbag leaves free: with less it goes on as if it recorded, and writes nothing."""


class Recording:
    """At most one rosbag at a time. The browser chooses neither name nor topics.

    Args:
        folder: Where bags go.
        minutes: Length after which a recording ends by itself.
    """

    def __init__(self, folder: str, minutes: float) -> None:
        self._folder, self._minutes = folder, minutes
        self._process: Optional[subprocess.Popen] = None
        self._asked = False  # to end
        self._told = False  # how it ended
        self.path = ""

    @property
    def is_on(self) -> bool:
        """Whether a bag is being written."""
        return self._process is not None and self._process.poll() is None

    def start(self, namespace: str) -> str:
        """Begin a bag of a robot's topics, `namespace` with a slash at both ends, and return its path.

        Raises:
            OSError: There is no room for it, or the last bag is still being finished.
        """
        if self.is_on and self._asked:
            raise OSError(f"{self.path} is still being finished; try again in a few seconds")
        if not self.is_on:
            os.makedirs(self._folder, exist_ok=True)
            if self._lack():
                raise OSError(self._lack())
            self.path = os.path.join(self._folder, time.strftime("web_%Y-%m-%d-%H-%M-%S.bag"))
            self._process = subprocess.Popen(
                self._command(namespace), stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL, preexec_fn=become_another_program(os.getpid()),
            )
            self._asked = self._told = False
        return self.path

    def look(self) -> str:
        """End a bag that gets nothing any more; return, once, why one ends by itself or holds nothing; else nothing."""
        if self._process is None or self._told:
            return ""
        status = self._process.poll()
        if status is None:
            if self._asked or not self._lack():
                return ""
            self.stop()
            self._told = True
            return f"the recording ends: {self._lack()}"
        self._told = True
        if self._asked:
            return "" if os.path.exists(self.path) else (
                "nothing was recorded: it was ended before rosbag had begun, which takes a few seconds")
        return f"the recording has ended: rosbag failed with status {status}" if status else ""

    def _lack(self) -> str:
        """Return what is said of a disk with too little room or that is gone, nothing of one that has enough."""
        try:
            free = shutil.disk_usage(self._folder).free
        except OSError as error:
            return f"{self._folder} is gone: {error.strerror}"
        if free >= LEAST_SPACE:
            return ""
        return f"{self._folder} has {free / 1e6:.0f} MB left, and rosbag leaves {LEAST_SPACE / 1e6:.0f} MB free"

    def stop(self) -> None:
        """End the bag, if there is one; rosbag gives it its name on an interrupt."""
        self._asked = True
        if self._process is not None and self._process.poll() is None:
            self._process.send_signal(signal.SIGINT)

    def close(self) -> None:
        """End the bag and wait until it is whole."""
        self.stop()
        if self._process is not None:
            try:
                self._process.wait(END_PATIENCE)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()

    def _command(self, namespace: str) -> List[str]:
        names = [topic if topic.startswith("/") else namespace + topic for topic in TOPICS]
        pattern = "|".join([f"{name}$" for name in names] + [f"{namespace}{PLANS}$"])
        return ["rosbag", "record", "-O", self.path, "--lz4", f"--duration={self._minutes:g}m", "-e", f"({pattern})"]
