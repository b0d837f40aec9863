"""Every executable says what it is for and what it takes."""

import os
import subprocess
from pathlib import Path

import pytest

pytest.importorskip("mbf_msgs", reason="needs the built package")

ROOT = Path(__file__).resolve().parents[3]
EXECUTABLES = sorted(path for path in (ROOT / "scripts").iterdir())


@pytest.mark.parametrize("path", EXECUTABLES, ids=lambda path: path.name)
def test_help_explains_the_arguments_without_a_ros_master(path):
    if path.name in ("demo", "test", "run"):
        command = [str(path), "--help"]
    else:
        command = ["rosrun", "mbf_relay", path.name, "--help"]
    environment = dict(os.environ, ROS_MASTER_URI="http://localhost:1")
    done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, env=environment, timeout=120.0)
    text = done.stdout.decode(errors="replace")
    assert done.returncode == 0, text
    assert len(text) > 60 and "Traceback" not in text
