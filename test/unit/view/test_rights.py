"""Who may look, who may drive, and which pages may speak for a person."""

import os
import stat

import pytest

from mbf_relay.view.rights import Rights, Tokens, is_loopback, is_own_page, keep_tokens, make_tokens

NAMES = {"localhost", "burger"}


def test_looking_and_driving_are_two_rights():
    tokens = Tokens("see", "drive")
    assert tokens.rights("drive") == Rights(True, True)
    assert tokens.rights("see") == Rights(True, False)
    for wrong in ("", "se", "sees", "Drive", "drive ", "ü", "\ud800"):
        assert tokens.rights(wrong) == Rights(False, False)


def test_on_this_machine_nobody_is_asked_unless_told_so():
    assert make_tokens("127.0.0.1", "", "") == Tokens("", "")
    assert Tokens("", "").rights("") == Rights(True, True)
    assert make_tokens("localhost", "", "secret").rights("") == Rights(True, False)


def test_whoever_asks_for_a_token_to_look_does_not_let_everybody_drive():
    assert make_tokens("127.0.0.1", "see", "").rights("") == Rights(False, False)
    assert make_tokens("127.0.0.1", "see", "").rights("see") == Rights(True, False)


def test_beyond_this_machine_tokens_are_made_anew_each_time():
    first, second = make_tokens("0.0.0.0", "", ""), make_tokens("0.0.0.0", "", "")
    assert min(map(len, first + second)) >= 20
    assert len({*first, *second}) == 4
    assert first.rights("") == Rights(False, False)


@pytest.mark.parametrize(
    "address, only_here",
    [
        ("127.0.0.1", True),
        ("127.1.2.3", True),
        ("::1", True),
        ("localhost", True),
        ("0.0.0.0", False),
        ("192.168.1.4", False),
        ("::", False),
        ("burger", False),
        ("", False),
    ],
)
def test_loopback_is_told_from_the_rest(address, only_here):
    assert is_loopback(address) is only_here


def test_only_their_owner_reads_the_tokens_even_where_a_file_lay_open(tmp_path):
    path = tmp_path / "deep" / "tokens.json"
    path.parent.mkdir()
    path.write_text("old")
    path.chmod(0o644)
    keep_tokens(str(path), Tokens("see", "drive"))
    assert stat.S_IMODE(os.stat(path).st_mode) == 0o600
    assert "drive" in path.read_text()
    assert os.listdir(path.parent) == ["tokens.json"]


@pytest.mark.parametrize("origin, host, own", [
    ("http://localhost:8642", "localhost:8642", True),
    ("http://127.0.0.1:8642", "127.0.0.1:8642", True),
    ("http://[::1]:8642", "[::1]:8642", True),
    ("https://burger", "burger", True),
    ("http://BURGER:8642", "burger:8642", True),
    (None, "localhost:8642", True),
    ("http://evil.example", "localhost:8642", False),
    ("http://localhost:9999", "localhost:8642", False),
    ("http://evil.example:8642", "evil.example:8642", False),  # its name was made to point here
    (None, "evil.example:8642", False),
    ("null", "localhost:8642", False),
    ("", "localhost:8642", False),
    ("http://localhost:8642", None, False),
    ("http://localhost:8642", "[", False),
    ("http://[::1", "localhost:8642", False),
])
def test_another_sites_page_can_neither_read_nor_drive(origin, host, own):
    assert is_own_page(origin, host, NAMES) is own
