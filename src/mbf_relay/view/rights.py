"""Who may look and who may drive: tokens, and the pages that may speak for a person."""

from __future__ import annotations

import hmac
import ipaddress
import json
import os
import secrets
from typing import Iterable, NamedTuple, Optional
from urllib.parse import urlsplit


class Rights(NamedTuple):
    """What one browser may do."""

    view: bool
    drive: bool


class Tokens(NamedTuple):
    """The words that open: empty where none is needed.

    Attributes:
        view: For looking.
        drive: For looking and driving.
    """

    view: str
    drive: str

    def rights(self, offered: str) -> Rights:
        """Return what a token gives; compared in a time that tells nothing about it."""
        drives = not self.drive or _equal(offered, self.drive)
        return Rights(drives or not self.view or _equal(offered, self.view), drives)


def _equal(one: str, other: str) -> bool:
    return hmac.compare_digest(one.encode("utf-8", "surrogatepass"), other.encode("utf-8", "surrogatepass"))


def is_loopback(address: str) -> bool:
    """Return whether only this machine reaches an address to listen on."""
    if address == "localhost":
        return True
    try:
        return ipaddress.ip_address(address).is_loopback
    except ValueError:
        return False


def make_tokens(address: str, view: str, drive: str) -> Tokens:
    """Return the tokens to ask for: those given, and beyond loopback a new one for each that was not.

    Where looking takes a token, driving does too.

    Args:
        address: Where the server listens.
        view, drive: Tokens set by the user, or empty.
    """
    if not is_loopback(address):
        view = view or secrets.token_urlsafe(16)
    if view:
        drive = drive or secrets.token_urlsafe(16)
    return Tokens(view, drive)


def keep_tokens(path: str, tokens: Tokens) -> None:
    """Write the tokens where only their owner can read them."""
    os.makedirs(os.path.dirname(path), exist_ok=True)
    fresh = f"{path}.{os.getpid()}"
    descriptor = os.open(fresh, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    with os.fdopen(descriptor, "w", encoding="utf-8") as stream:
        json.dump(tokens._asdict(), stream)
        stream.write("\n")
    os.replace(fresh, path)


def is_own_page(origin: Optional[str], host: Optional[str], names: Iterable[str]) -> bool:
    """Return whether a WebSocket was opened by a page of this server and not by another site's.

    A browser tells the page's origin truthfully. That it equals the host asked for is not enough: a site whose name was
    made to point here ("DNS rebinding") would pass; so the name must be one of ours, or an address.

    Args:
        origin: The request's Origin header; None from a program that is no browser, which no site can misuse.
        host: The request's Host header.
        names: Host names that mean this machine.
    """
    if not is_own_host(host, names):
        return False
    try:
        return origin is None or urlsplit(origin).netloc.lower() == (host or "").lower()
    except ValueError:
        return False


def is_own_host(host: Optional[str], names: Iterable[str]) -> bool:
    """Return whether a request was made to a name or an address of this machine; arguments as for `is_own_page`."""
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
