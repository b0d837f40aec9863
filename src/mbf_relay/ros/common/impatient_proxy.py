"""XML-RPC proxies for ROS masters and nodes, with a timeout: a peer may accept the connection and never answer."""

from __future__ import annotations

import http.client
import xml.parsers.expat  # nosec B407: xmlrpc's own
import xmlrpc.client  # nosec B411: what the ROS master speaks
from typing import Any

NO_ANSWER = (OSError, http.client.HTTPException, xmlrpc.client.Error, xml.parsers.expat.ExpatError, ValueError)
"""What a call raises where there is no answer or no valid one; ValueError is for an invalid address."""


def impatient_proxy(address: str, timeout: float) -> xmlrpc.client.ServerProxy:
    """Return a proxy whose calls raise OSError after `timeout` seconds of silence."""
    return xmlrpc.client.ServerProxy(address, transport=_ImpatientTransport(timeout))


class _ImpatientTransport(xmlrpc.client.Transport):
    def __init__(self, timeout: float) -> None:
        super().__init__()
        self._timeout = timeout

    def make_connection(self, host: Any) -> http.client.HTTPConnection:
        connection = super().make_connection(host)
        connection.timeout = self._timeout
        return connection
