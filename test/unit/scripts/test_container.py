"""The Debian package, built and installed as scripts/Dockerfile says, in systems that have nothing but Debian."""

import json
import os
import shutil
import subprocess
from pathlib import Path

import pytest
from tally import LONG

ROOT = Path(__file__).resolve().parents[3]
DOCKERFILE = ROOT / "scripts" / "Dockerfile"
BASE, SUITE, MIRROR = "debian:12-slim", "bookworm", "http://deb.debian.org/debian"
TAG = f"mbf_relay_test_{os.getpid()}"
CERTIFICATES, LENT = "/etc/ssl/certs/ca-certificates.crt", "/lent.crt"


def run(*command, timeout=6000.0):
    done = subprocess.run(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace", timeout=timeout
    )
    assert done.returncode == 0, f"'{' '.join(command)}' said:\n{done.stdout[-4000:]}"
    return done.stdout


def succeeds(*command, timeout):
    """Return whether a command ends well, and in time (s)."""
    return subprocess.run(["timeout", str(timeout), *command], stdout=subprocess.DEVNULL,
                          stderr=subprocess.DEVNULL).returncode == 0


class Containers:
    """Docker, or buildah, which needs no daemon and whose steps run in a chroot.

    Attributes:
        tool: Which of them.
    """

    def __init__(self, tool, folder):
        self.tool = tool
        self._folder = folder
        self._made = []

    def get_base(self):
        """Pull the image that the Dockerfile begins with or, without a way to its registry, make the like."""
        if succeeds(self.tool, "image", "inspect", BASE, timeout=60) or succeeds(self.tool, "pull", BASE, timeout=300):
            return
        if not shutil.which("mmdebstrap"):
            pytest.skip(f"{BASE} can be neither pulled nor, without mmdebstrap, made")
        archive = self._folder / "base.tar"
        run("mmdebstrap", "--variant=minbase", SUITE, str(archive), f"deb {MIRROR} {SUITE} main")
        (self._folder / "Dockerfile").write_text("FROM scratch\nADD base.tar /\n")
        self._made.append(BASE)
        run(self.tool, "build", "-t", BASE, str(self._folder))
        archive.unlink()

    def build(self):
        """Build the checkout's image."""
        options = []
        if self.tool == "buildah":  # a machine whose way to PyPI has certificates of its own lends them
            settings = self._folder / "pip.conf"
            settings.write_text(f"[global]\ncert = {LENT}\n")
            options = ["--isolation", "chroot", "--volume", f"{CERTIFICATES}:{LENT}:ro", "--volume",
                       f"{settings}:/etc/pip.conf:ro"]
        self._made.append(TAG)
        run(self.tool, "build", *options, "-t", TAG, "-f", str(DOCKERFILE), str(ROOT))

    def run(self, *command):
        """Run a command in it, or what it runs by itself."""
        if self.tool == "docker":
            return run("docker", "run", "--rm", TAG, *command)
        settings = json.loads(run("buildah", "inspect", "--type", "image", TAG))["OCIv1"]["config"]
        container = run("buildah", "from", TAG).strip().splitlines()[-1]
        try:
            words = settings["Entrypoint"] + (list(command) or settings["Cmd"])
            return run("buildah", "run", "--isolation", "chroot", container, "--", *words)
        finally:
            run("buildah", "rm", container)

    def close(self):
        """Remove what was made."""
        for image in reversed(self._made):
            succeeds(self.tool, "rmi", image, timeout=300)


@pytest.fixture
def containers(tmp_path):
    tool = next((tool for tool in ("docker", "buildah") if succeeds(tool, "info", timeout=60)), None)
    if tool is None:
        pytest.skip("there is neither docker nor buildah")
    containers = Containers(tool, tmp_path)
    yield containers
    containers.close()


@pytest.mark.skipif(not LONG, reason="builds, packages and installs on bare systems")
def test_a_machine_with_nothing_but_debian_drives_the_circle_by_apt_alone(containers):
    containers.get_base()
    containers.build()
    kernels = "from mbf_relay import kernels; kernels.compile_all(); print(kernels.reason_in_process())"
    assert containers.run("python3", "-c", kernels).strip() == "None", "no numba, and so nothing to compile"
    assert "/opt/mbf_relay" in containers.run("python3", "-c", "import mbf_msgs, pybullet; print(mbf_msgs.__file__)")
    assert "Drove circle with result: True" in containers.run()
