"""What the READMEs say of drives without ROS, read out of them and run: nobody waits for it by the wall clock."""

import json
import shlex

import pytest
from programs import program
from readmes import ROOT, command_with, run_to_end

pytest.importorskip("mbf_msgs", reason="rosrun finds programs of the built package")

PATIENCE = 600.0
"""Wall seconds for one program, which gives way to what drives beside it."""


def test_drives_without_ros_are_compared(tmp_path):
    worlds = json.loads((ROOT / "config" / "worlds" / "sample.json").read_text())
    worlds["worlds"] = worlds["worlds"][:1]
    (tmp_path / "worlds.json").write_text(json.dumps(worlds))
    for command in (
        command_with("batch.py circle").replace("--seeds 100", "--seeds 1"),
        f"{shlex.quote(program('batch.py'))} worlds.json",
        command_with("batch.py worlds.json"), command_with("compare.py"),
    ):
        run_to_end(command, str(tmp_path), timeout=PATIENCE)
