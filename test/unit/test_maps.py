import subprocess
import sys

import numpy as np
import pytest
from PIL import Image

from mbf_relay import maps
from mbf_relay.geometry import Pose2D
from mbf_relay.maps import MapFileError, MapImageError, OccupancyMap, load_map, save_map


def write(folder, pixels, mode="trinary", negate=0, origin="[0.0, 0.0, 0.0]", name="map.png", thresholds=(0.65, 0.196)):
    Image.fromarray(pixels).save(str(folder / name))
    path = folder / "map.yaml"
    path.write_text(
        f"image: {name}\nresolution: 0.1\norigin: {origin}\nnegate: {negate}\n"
        f"occupied_thresh: {thresholds[0]}\nfree_thresh: {thresholds[1]}\nmode: {mode}\n"
    )
    return str(path)


def test_trinary_knows_free_occupied_and_between_and_turns_the_image(tmp_path):
    pixels = np.array([[0, 255], [128, 254]], dtype=np.uint8)
    occupancy = load_map(write(tmp_path, pixels, origin="[2.0, 3.0, 1.0]"))
    assert occupancy.data.tolist() == [[-1, 0], [100, 0]]
    assert occupancy.resolution == 0.1
    assert occupancy.origin == Pose2D(2.0, 3.0, 1.0)


@pytest.mark.parametrize("negate", [1, "'1'", '"1"', "true"])  # yaml-cpp does not care for quotes
def test_negate_swaps_black_and_white(tmp_path, negate):
    occupancy = load_map(write(tmp_path, np.array([[0, 255]], dtype=np.uint8), negate=negate))
    assert occupancy.data.tolist() == [[0, 100]]


def test_scale_grades_between_the_thresholds(tmp_path):
    occupancy = load_map(write(tmp_path, np.array([[255, 0, 128, 200]], dtype=np.uint8), mode="scale"))
    share = (255 - 128) / 255.0
    assert occupancy.data[0, :3].tolist() == [0, 100, int(1 + 98 * (share - 0.196) / (0.65 - 0.196))]


@pytest.mark.parametrize("mode", ["trinary", "scale"])
def test_a_map_without_unknown_cells_has_its_thresholds_crossed(tmp_path, mode):
    """Makers of maps write 0.1 and 0.9, or 0.05 and 0.95: what is not occupied is free."""
    pixels = np.array([[255, 242, 216, 128, 0]], dtype=np.uint8)
    occupancy = load_map(write(tmp_path, pixels, mode=mode, thresholds=(0.1, 0.9)))
    assert occupancy.data.tolist() == [[0, 0, 100, 100, 100]]


def test_scale_takes_transparent_for_unknown_and_leaves_alpha_out_of_the_average(tmp_path):
    pixels = np.array([[[128, 128, 128, 0], [128, 128, 128, 255], [0, 0, 0, 0]]], dtype=np.uint8)
    occupancy = load_map(write(tmp_path, pixels, mode="scale"))
    assert occupancy.data[0, 0] == -1
    assert 0 < occupancy.data[0, 1] < 100
    assert occupancy.data[0, 2] == 100


def test_trinary_counts_alpha_as_a_colour(tmp_path):
    pixels = np.array([[[0, 0, 0, 255], [0, 0, 0, 0]]], dtype=np.uint8)
    occupancy = load_map(write(tmp_path, pixels))
    assert occupancy.data.tolist() == [[100, 100]]  # (255 - 63.75) / 255 = 0.75 is still above 0.65
    occupancy = load_map(write(tmp_path, pixels, thresholds=(0.8, 0.1)))
    assert occupancy.data.tolist() == [[-1, 100]]


def test_raw_hands_values_through(tmp_path):
    occupancy = load_map(write(tmp_path, np.array([[0, 1, 100, 127, 255]], dtype=np.uint8), mode="raw"))
    assert occupancy.data.tolist() == [[0, 1, 100, 127, -1]]


@pytest.mark.parametrize("name", ["map.pgm", "map.png", "map.bmp"])
def test_image_formats_agree(tmp_path, name):
    pixels = np.random.RandomState(1).randint(0, 256, (7, 11)).astype(np.uint8)
    assert load_map(write(tmp_path, pixels, name=name)).data.tolist() == load_map(write(tmp_path, pixels)).data.tolist()


def test_sixteen_bit_and_palette_images_are_read_by_their_brightness(tmp_path):
    path = write(tmp_path, np.array([[0, 65535]], dtype=np.uint16))
    assert load_map(path).data.tolist() == [[100, 0]]
    Image.fromarray(np.array([[0, 255]], dtype=np.uint8)).convert("P").save(str(tmp_path / "map.png"))
    assert load_map(path).data.tolist() == [[100, 0]]


def plain_map(folder, content):
    (folder / "map.pgm").write_bytes(content)
    path = folder / "map.yaml"
    path.write_text(
        "image: map.pgm\nresolution: 0.1\norigin: [0.0, 0.0, 0.0]\nnegate: 0\noccupied_thresh: 0.65\n"
        "free_thresh: 0.196\n")
    return str(path)


def test_a_map_as_map_saver_writes_it_takes_no_library_of_images(tmp_path):
    path = plain_map(tmp_path, b"P5\n# 0.050 m/pix\n2 1\n255\n\x00\xfe")
    code = f"import sys; from mbf_relay import maps; print(maps.load_map({path!r}).data.tolist(), 'PIL' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], stdout=subprocess.PIPE, check=True, timeout=60.0)
    assert done.stdout.decode().strip() == "[[100, 0]] False"


@pytest.mark.parametrize("head", [
    b"P5\n3 2\n255\n", b"P5 3 2 255 ", b"P5\n#one\n# two\r\n3\t2\r255\n", b"P5\n3 #width\n2\n255\n",
    b"P5\n3 2\n100\n", b"P5\n3 2\n255\n#", b"P5\n03 002 255\n", b"P5\n3 2\n#end\n255\n",
])
@pytest.mark.parametrize("band", [1, 4, 1 << 22])
def test_it_shows_what_pillow_finds_in_it(tmp_path, monkeypatch, head, band):
    monkeypatch.setattr(maps, "BAND", band)
    path = plain_map(tmp_path, head + b"\x00\x50\x80\xc8\xfe\xff and what comes after")
    shown = load_map(path).data.tolist()
    monkeypatch.setattr(maps, "_read_plain", lambda *_: None)
    assert shown == load_map(path).data.tolist()


@pytest.mark.parametrize("content", [
    b"", b"P5", b"P5\n3 2\n255\n\x00\x01", b"P5\n0 2\n255\n\x00", b"P5\n40000 1\n255\n" + bytes(40000),
    b"P5\n999999999 999999999\n255\n\x00", b"P5\n-3 2\n255\n" + bytes(6),
])
def test_a_map_that_is_cut_off_or_too_large_is_refused(tmp_path, content):
    with pytest.raises(MapImageError, match="map.pgm"):
        load_map(plain_map(tmp_path, content))


@pytest.mark.parametrize("yaw", [0.0, 0.7])
def test_saved_maps_come_back_the_same(tmp_path, yaw):
    data = np.random.RandomState(2).choice(np.array([-1, 0, 100], dtype=np.int8), (13, 9))
    occupancy = OccupancyMap(data, 0.05, Pose2D(-1.25, 2.125, yaw))
    yaml_path, image_path = save_map(str(tmp_path / "saved map"), occupancy)
    assert image_path.endswith("saved map.pgm")
    again = load_map(yaml_path)
    assert np.array_equal(again.data, data)
    assert again.origin == occupancy.origin
    assert again.resolution == occupancy.resolution


@pytest.mark.parametrize("name", ["ü" * 30, "ground floor, " * 10, "1.0", "#a: b", "- it's \"one\""])
def test_a_map_of_any_name_is_found_again(tmp_path, name):
    """The name was cut off after 80 characters with a blank, or 20 of a script that YAML escapes."""
    occupancy = OccupancyMap(np.zeros((2, 3), dtype=np.int8), 0.05, Pose2D(0.0, 0.0, 0.0))
    assert load_map(save_map(str(tmp_path / name), occupancy)[0]).data.shape == (2, 3)


def test_saving_keeps_to_the_thresholds(tmp_path):
    data = np.array([[0, 25, 26, 64, 65, 100, -1]], dtype=np.int8)
    yaml_path, _ = save_map(str(tmp_path / "m"), OccupancyMap(data, 0.05, Pose2D(0.0, 0.0, 0.0)))
    assert load_map(yaml_path).data.tolist() == [[0, 0, -1, -1, 100, 100, -1]]
    with pytest.raises(ValueError, match="occ 20 and free 30"):
        save_map(str(tmp_path / "m"), OccupancyMap(data, 0.05, Pose2D(0.0, 0.0, 0.0)), occupied=20, free=30)


@pytest.mark.parametrize(
    "change, complaint",
    [
        (("resolution: 0.1\n", ""), "lacks resolution"),
        (("resolution: 0.1", "resolution: -1"), "resolution is -1"),
        (("resolution: 0.1", "resolution: 1" + 400 * "0"), "resolution is 1e"),
        (("resolution: 0.1", "resolution: thick"), "resolution is 'thick'"),
        (("trinary", "ternary"), "mode is 'ternary'"),
        (("[0.0, 0.0, 0.0]", "[0.0, 0.0]"), "origin has 2 entries"),
        (("free_thresh: 0.196", "free_thresh: 1.9"), "free_thresh is 1.9"),
        (("image: map.png", "image: ''"), "image is empty"),
        (("image", "{"), "no YAML"),
    ],
)
def test_a_wrong_file_is_named_with_what_is_wrong(tmp_path, change, complaint):
    path = write(tmp_path, np.zeros((2, 2), dtype=np.uint8))
    with open(path) as file:
        text = file.read()
    assert change[0] in text
    with open(path, "w") as file:
        file.write(text.replace(change[0], change[1], 1))
    with pytest.raises(MapFileError, match=complaint) as caught:
        load_map(path)
    assert path in str(caught.value)


def test_a_missing_or_broken_image_is_named(tmp_path):
    path = write(tmp_path, np.zeros((2, 2), dtype=np.uint8))
    (tmp_path / "map.png").write_bytes(b"no image at all")
    with pytest.raises(MapImageError, match="map.png"):
        load_map(path)
    (tmp_path / "map.png").unlink()
    with pytest.raises(OSError, match="map.png"):
        load_map(path)


def test_numbers_in_scientific_form_are_numbers(tmp_path):
    path = write(tmp_path, np.zeros((2, 2), dtype=np.uint8), origin="[-1e1, 5e-2, 0]")
    assert load_map(path).origin == Pose2D(-10.0, 0.05, 0.0)


@pytest.mark.parametrize("yaw", ["nan", ".nan", "NaN"])
def test_a_map_of_an_old_map_saver_is_not_turned(tmp_path, yaw):
    """It wrote so of maps that lie as they are, Willow Garage's among them; an unknown corner will not do."""
    path = write(tmp_path, np.zeros((2, 2), dtype=np.uint8), origin=f"[-16.6, -6.65, {yaw}]")
    assert load_map(path).origin == Pose2D(-16.6, -6.65, 0.0)
    with pytest.raises(MapFileError, match="origin"):
        load_map(write(tmp_path, np.zeros((2, 2), dtype=np.uint8), origin=f"[{yaw}, -6.65, 0.0]"))


def image_of(kind):
    """Return an image of 5 x 3 pixels of a kind, dark above and bright below."""
    grey = (np.arange(15).reshape(3, 5) * 18).astype(np.uint8)
    image = Image.fromarray(grey)
    if kind == "I;16":
        return Image.fromarray(grey.astype(np.uint16) * 256 + 255 - grey)
    if kind == "transparent palette":
        image = image.convert("P")
        image.info["transparency"] = 3
        return image
    alpha = Image.fromarray(np.where(np.arange(15).reshape(3, 5) % 4, 255, 0).astype(np.uint8))
    if kind in ("LA", "RGBA"):
        image = image.convert(kind)
        image.putalpha(alpha)
    return image.convert(kind)


@pytest.mark.parametrize("kind", ["L", "1", "P", "transparent palette", "LA", "RGB", "RGBA", "I;16"])
@pytest.mark.parametrize("mode", ["trinary", "scale", "raw"])
def test_a_large_image_read_band_by_band_is_the_map_it_is_as_a_whole(tmp_path, monkeypatch, kind, mode):
    path = write(tmp_path, np.zeros((2, 2), dtype=np.uint8), mode)
    image_of(kind).save(str(tmp_path / "map.png"))
    whole = load_map(path).data
    assert whole.shape == (3, 5) and whole.dtype == np.int8
    for band in (1, 5, 10, 14):
        monkeypatch.setattr(maps, "BAND", band)
        assert load_map(path).data.tolist() == whole.tolist()
    if mode == "scale" and kind in ("L", "P", "RGB", "I;16"):
        share = 1.0 - np.arange(15).reshape(3, 5)[::-1] * 18 / 255.0
        graded = (1.0 + 98.0 * (share - 0.196) / (0.65 - 0.196)).clip(1, 99).astype(int)
        assert whole.tolist() == np.where(share < 0.196, 0, np.where(share > 0.65, 100, graded)).tolist()


@pytest.mark.parametrize("limit, value", [("LARGEST_SIDE", 4), ("MOST_CELLS", 14)])
@pytest.mark.parametrize("name", ["map.png", "map.pgm"])
@pytest.mark.parametrize("turned", [False, True])
def test_an_image_of_more_pixels_than_a_map_may_have_is_refused_with_its_size(
        tmp_path, monkeypatch, limit, value, name, turned):
    pixels = np.zeros((5, 3) if turned else (3, 5), dtype=np.uint8)
    path = write(tmp_path, pixels, name=name)
    monkeypatch.setattr(maps, limit, value + 1)
    assert load_map(path).data.shape == pixels.shape
    monkeypatch.setattr(maps, limit, value)
    with pytest.raises(MapImageError, match="has 3 x 5 pixels" if turned else "has 5 x 3 pixels"):
        load_map(path)


@pytest.mark.parametrize("wrong", [np.nan, np.inf, -np.inf, 1e12])
def test_an_image_with_pixels_that_are_no_brightness_is_refused(tmp_path, wrong):
    path = write(tmp_path, np.array([[0.0, 200.0], [wrong, 255.0]], dtype=np.float32), name="map.tiff")
    with pytest.raises(MapImageError, match="pixels that are no numbers, or larger"):
        load_map(path)
