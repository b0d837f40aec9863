"""Access control of the web view: tokens for viewing and driving, and checks of a request's origin and host."""

from __future__ import annotations

import hmac
import ipaddress
import json
import os
import secrets
from typing import Iterable, NamedTuple, Optional
from urllib.parse import urlsplit


class Rights(NamedTuple):
    """Whether a browser may view and drive."""

    view: bool
    drive: bool


class Tokens(NamedTuple):
    """The required tokens; empty where none is needed.

    Attributes:
        view: Token for viewing.
        drive: Token for viewing and driving.
    """

    view: str
    drive: str

    def rights(self, offered: str) -> Rights:
        """Return the rights that an offered token gives; it is compared in constant time."""
        drives = not self.drive or _equal(offered, self.drive)
        return Rights(drives or not self.view or _equal(offered, self.view), drives)


def _equal(one: str, other: str) -> bool:
    return hmac.compare_digest(one.encode("utf-8", "surrogatepass"), other.encode("utf-8", "surrogatepass"))


def is_loopback(address: str) -> bool:
    """Return whether an address to listen on is reachable from this machine only."""
    if address == "localhost":
        return True
    try:
        return ipaddress.ip_address(address).is_loopback
    except ValueError:
        return False


def make_tokens(address: str, view: str, drive: str) -> Tokens:
    """Return the required tokens: those given, and for an address that is not loopback, new ones for the others.

    Where viewing needs a token, driving does, too.

    Args:
        address: Address on which the server listens.
        view, drive: Tokens set by the user, or empty.
    """
    if not is_loopback(address):
        view = view or secrets.token_urlsafe(16)
    if view:
        drive = drive or secrets.token_urlsafe(16)
    return Tokens(view, drive)


def keep_tokens(path: str, tokens: Tokens) -> None:
    """Write the tokens to a file that only its owner can read."""
    os.makedirs(os.path.dirname(path), exist_ok=True)
    fresh = f"{path}.{os.getpid()}"
    descriptor = os.open(fresh, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    with os.fdopen(descriptor, "w", encoding="utf-8") as stream:
        json.dump(tokens._asdict(), stream)
        stream.write("\n")
    os.replace(fresh, path)


def is_own_page(origin: Optional[str], host: Optional[str], names: Iterable[str]) -> bool:
    """Return whether a WebSocket was opened by a page of this server and not by another site's.

    Browsers send the page's true origin. That it equals the Host header is not enough, since a site whose name resolves
    to this machine (DNS rebinding) would pass; so the host must be a known name or an IP address.

    Args:
        origin: The request's Origin header; None from a program that is no browser, which other sites cannot use.
        host: The request's Host header.
        names: Host names of this machine.
    """
    if not is_own_host(host, names):
        return False
    try:
        return origin is None or urlsplit(origin).netloc.lower() == (host or "").lower()
    except ValueError:
        return False


def is_own_host(host: Optional[str], names: Iterable[str]) -> bool:
    """Return whether the Host header is one of `names` or an IP address; arguments as for `is_own_page`."""
    try:
        name = urlsplit(f"//{host or ''}").hostname or ""
    except ValueError:
        return False
    if name in {known.lower() for known in names}:
        return True
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True
