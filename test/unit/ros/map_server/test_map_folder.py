"""A map server that is kept to a folder gives nobody what lies elsewhere."""

import os

import pytest

from mbf_relay.ros.map_server.node import is_below

YAML = "image: {}\nresolution: 0.05\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"


@pytest.fixture()
def folder(tmp_path):
    allowed = tmp_path / "maps"
    allowed.mkdir()
    (tmp_path / "secret.pgm").write_bytes(b"P5 1 1 255\n0")
    (tmp_path / "other.yaml").write_text(YAML.format("secret.pgm"))
    for name, image in (("inside", "floor.pgm"), ("up", "../secret.pgm"), ("absolute", str(tmp_path / "secret.pgm"))):
        (allowed / f"{name}.yaml").write_text(YAML.format(image))
    (allowed / "linked.yaml").write_text(YAML.format("link.pgm"))
    os.symlink(str(tmp_path / "secret.pgm"), str(allowed / "link.pgm"))
    return allowed


@pytest.mark.parametrize(
    "name, allowed",
    [
        ("inside.yaml", True),
        ("missing.yaml", True),
        ("../other.yaml", False),
        ("up.yaml", False),
        ("absolute.yaml", False),
        ("linked.yaml", False),
        ("../maps2/inside.yaml", False),
        ("/etc/passwd", False),
        ("", True),
    ],
)
def test_only_what_lies_below_the_folder_with_its_image_is_opened(folder, name, allowed):
    assert is_below(os.path.join(str(folder), name), str(folder)) is allowed
