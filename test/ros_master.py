"""A ROS master that a test starts, asks and kills."""

import subprocess
import sys
import xmlrpc.client

from ros_testing import wait_until


class Master:
    """A ROS master in a process of its own."""

    def __init__(self, port):
        self.uri = f"http://localhost:{port}"
        self.proxy = xmlrpc.client.ServerProxy(self.uri)
        self._process = subprocess.Popen(
            [sys.executable, "-c", "import rosmaster; rosmaster.rosmaster_main()", "--core", "-p", str(port)],
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )
        wait_until(lambda: self.answer("getPid"), "a master to answer")

    def answer(self, name, *arguments):
        """Return what the master says, None where it cannot."""
        try:
            code, _, value = getattr(self.proxy, name)("/test", *arguments)
        except (OSError, xmlrpc.client.Error):
            return None
        return value if code == 1 else None

    def kill(self):
        self._process.kill()
        self._process.wait()
