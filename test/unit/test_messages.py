"""The mbf_msgs built from action/ are those of Move Base Flex's master branch, to the checksum."""

import os
import subprocess

import pytest

pytest.importorskip("mbf_msgs.msg", reason="mbf_msgs is not built: run scripts/test")

import mbf_msgs.msg  # noqa: E402
import rospkg  # noqa: E402

ACTION_FOLDER = os.path.realpath(os.path.join(os.path.dirname(__file__), "..", "..", "action"))
MASTER_SUMS = {
    "MoveBaseAction": "b044be2ca997add2dbbccd9fa0a095b6",
    "GetPathAction": "30a72de8fdd422809b5652337191ad66",
    "ExePathAction": "612b0e536656f46f77caecc9772e4bcd",
    "RecoveryAction": "7f0b73a03d963f251558d4e79a23265a",
}


def built_here() -> bool:
    """Return whether the mbf_msgs in force is that of action/ and not the system's."""
    try:
        return os.path.realpath(rospkg.RosPack().get_path("mbf_msgs")) == ACTION_FOLDER
    except rospkg.ResourceNotFound:
        return False


@pytest.mark.parametrize("name", sorted(MASTER_SUMS))
def test_actions_have_the_checksums_of_master(name: str) -> None:
    if not built_here():
        pytest.skip("the mbf_msgs in force is not the one of action/")
    assert getattr(mbf_msgs.msg, name)._md5sum == MASTER_SUMS[name]


@pytest.mark.parametrize("name", sorted(MASTER_SUMS))
def test_rosmsg_shows_the_actions(name: str) -> None:
    shown = subprocess.run(["rosmsg", "show", f"mbf_msgs/{name}"], stdout=subprocess.PIPE, check=True)
    assert b"action_goal" in shown.stdout
