"""The package with release 0.4.0 of mbf_msgs, which is what Noetic installs."""

import json
import os
import subprocess
import sys
from pathlib import Path

import older_messages
import pytest

TEST_FOLDER = Path(__file__).resolve().parents[2]
SOURCE_FOLDER = TEST_FOLDER.parent / "src" / "mbf_relay"
RELEASE_SUMS = {
    "msg.MoveBaseAction": "c98ceb3d38dd07397b09c7280aa0d553", "msg.GetPathAction": "f4d6567e6c5805b81da135676625d187",
    "msg.ExePathAction": "1eb3204035d1ceb85b999c9c0a477f7b", "msg.RecoveryAction": "b35ffa9c1783e3d612414d87fbc80598",
    "srv.CheckPoint": "098ffffe56a4f2f59d33aa09df0749c1", "srv.CheckPose": "540ccc67006cf1c2c5502427e26c7f21",
    "srv.CheckPath": "59ef27f5ce7e3cc3c7f7a0f823bca55c",
}
CODES = """
import json, mbf_msgs.msg as msg
from mbf_relay.navigation.goals import NavigateOutcome
from mbf_relay.outcomes import ControlOutcome, PlanOutcome, RecoveryOutcome
from mbf_relay.ros.common.outcome_codes import code_of
types = {msg.MoveBaseResult: NavigateOutcome, msg.GetPathResult: PlanOutcome, msg.ExePathResult: ControlOutcome,
         msg.RecoveryResult: RecoveryOutcome}
print(json.dumps({f"{kind.__name__}.{outcome.name}": [code_of(outcome, kind), getattr(kind, outcome.name, None)]
                  for kind, outcomes in types.items() for outcome in outcomes}))
"""
LACKING = {
    "GetPathResult.BLOCKED_START": 52, "GetPathResult.BLOCKED_GOAL": 53, "ExePathResult.BLOCKED_GOAL": 100,
    "MoveBaseResult.STOPPED": 17,
}
"""What the release has no name for, and the number that stands for it.

INVALID_START, INVALID_GOAL, FAILURE, INTERNAL_ERROR.
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("release")
    older_messages.make(made)
    return made


def run(folder, *arguments):
    """Run Python with the release's messages and return what it prints."""
    path = os.pathsep.join([str(folder), str(TEST_FOLDER), *filter(None, [os.environ.get("PYTHONPATH")])])
    done = subprocess.run(
        [sys.executable, *arguments], env={**os.environ, "PYTHONPATH": path}, stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT, timeout=300.0,
    )
    text = done.stdout.decode(errors="replace")
    assert done.returncode == 0, text
    return text


def test_they_are_those_of_the_release_to_the_checksum(folder):
    sums = "import json, mbf_msgs.msg as msg, mbf_msgs.srv as srv\n" + "print(json.dumps({{{}}}))".format(
        ", ".join(f"{name!r}: {name}._md5sum" for name in RELEASE_SUMS))
    assert json.loads(run(folder, "-c", sums)) == RELEASE_SUMS


def test_an_outcome_has_the_release_s_number(folder):
    codes = json.loads(run(folder, "-c", CODES))
    assert {name: code for name, (code, named) in codes.items() if named is None} == LACKING
    assert all(code == named for code, named in codes.values() if named is not None)
    assert codes["GetPathResult.NO_PATH_FOUND"][0] == 54 and codes["ExePathResult.TF_ERROR"][0] == 111


def test_every_module_and_every_rostest_can_be_imported(folder):
    modules = [
        ".".join(("mbf_relay", *path.relative_to(SOURCE_FOLDER).with_suffix("").parts))
        for path in sorted(SOURCE_FOLDER.glob("ros/*/[a-z]*.py"))
    ]
    tests = [f"{room}.{path.stem}" for room in ("node", "system") for path in sorted(TEST_FOLDER.glob(f"{room}/*.py"))]
    assert len(modules) > 30 and len(tests) > 20
    run(folder, "-c", f"import importlib\nfor name in {modules + tests}: importlib.import_module(name)")


def test_the_relay_does_the_same(folder):
    here = Path(__file__).parent / "relay"
    files = [
        str(here / f"{name}.py")
        for name in ("test_relay", "test_relay_answers", "test_relay_machine", "test_relay_services")
    ]
    assert " passed" in run(folder, "-m", "pytest", "-q", "-p", "no:cacheprovider", *files)
