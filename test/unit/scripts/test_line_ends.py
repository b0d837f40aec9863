"""The package as git hands it out."""

import pathlib
import shutil
import subprocess

import pytest

CHECKOUT = pathlib.Path(__file__).resolve().parents[3]
PROGRAMS = ["scripts/run", "scripts/amcl", "config/Dwa.cfg"]


@pytest.mark.skipif(shutil.which("git") is None, reason="needs git")
def test_programs_start_where_git_was_told_to_give_files_the_line_ends_of_windows(tmp_path, monkeypatch):
    """Of a clone made on Windows and copied to a robot, nothing started: `bash\\r: No such file or directory`."""
    for name in ("GIT_DIR", "GIT_WORK_TREE", "GIT_INDEX_FILE"):
        monkeypatch.delenv(name, raising=False)
    origin, clone = tmp_path / "origin", tmp_path / "clone"
    for name in [".gitattributes", *PROGRAMS]:
        (origin / name).parent.mkdir(parents=True, exist_ok=True)
        if (CHECKOUT / name).exists():
            shutil.copy(str(CHECKOUT / name), str(origin / name))
    user = ["-c", "user.name=nobody", "-c", "user.email=nobody@example.org"]
    for command in (["init", "-q"], ["add", "."], [*user, "commit", "-q", "-m", "all"]):
        subprocess.run(["git", *command], cwd=str(origin), check=True)
    subprocess.run(["git", "clone", "-q", "-c", "core.autocrlf=true", str(origin), str(clone)], check=True)
    assert [name for name in PROGRAMS if b"\r" in (clone / name).read_bytes()] == []
