"""Recording of a drive with rosbag, started and stopped from a browser."""

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
"""Topics that drive_report.py needs, and those of a person's commands; without a slash, in the robot's namespace."""
PLANS = "move_base(_flex)?/[^/]+/plan"
END_PATIENCE = 5.0
LEAST_SPACE = 1 << 30
"""Free disk space (bytes) below which rosbag keeps running but writes nothing."""


class Recording:
    """Runs at most one rosbag at a time. The browser chooses neither the bag's name nor its topics.

    Args:
        folder: Folder of the bags; created where it is missing.
        minutes: Longest duration (min) of a recording.
    """

    def __init__(self, folder: str, minutes: float) -> None:
        self._folder, self._minutes = folder, minutes
        self._process: Optional[subprocess.Popen] = None
        self._asked = False  # whether rosbag was told to end
        self._told = False  # whether its end was reported
        self.path = ""

    @property
    def is_on(self) -> bool:
        """Whether rosbag is running, also while it still finishes a bag."""
        return self._process is not None and self._process.poll() is None

    def start(self, namespace: str) -> str:
        """Start recording a robot's topics, `namespace` with a slash at both ends; return the bag's path.

        Raises:
            OSError: The disk is too full, or the last bag is still being finished.
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

    def check(self) -> str:
        """Stop rosbag on a full disk; return, once, why a recording ended by itself or is empty; else an empty text."""
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
        """Return why the disk cannot be written to: too full, or not there; empty where it can."""
        try:
            free = shutil.disk_usage(self._folder).free
        except OSError as error:
            return f"{self._folder} is gone: {error.strerror}"
        if free >= LEAST_SPACE:
            return ""
        return f"{self._folder} has {free / 1e6:.0f} MB left, and rosbag leaves {LEAST_SPACE / 1e6:.0f} MB free"

    def stop(self) -> None:
        """Interrupt rosbag, if it is running: it then finishes the bag and removes the .active from its name."""
        self._asked = True
        if self._process is not None and self._process.poll() is None:
            self._process.send_signal(signal.SIGINT)

    def close(self) -> None:
        """Stop recording and wait until the bag is finished; kill rosbag after END_PATIENCE (s)."""
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
