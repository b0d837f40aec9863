"""Occupancy maps and their files in map_server's format: a YAML file and an image."""

from __future__ import annotations

import contextlib
import math
import os
import re
import struct
import threading
import warnings
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, BinaryIO, Iterator, Optional, Tuple

import numpy as np
import yaml

from mbf_relay import files
from mbf_relay.geometry import Pose2D
from mbf_relay.grid import Grid
from mbf_relay.parameters import ParameterSet, parameter
from mbf_relay.whole_files import whole_file, write_whole

if TYPE_CHECKING:
    from PIL import Image  # else where it is used: every node knows maps, one reads images

FINEST, COARSEST = 0.001, 50.0
"""Allowed range (m) of a map's resolution: on finer ones, loops over the cells in a radius would take too long."""
LARGEST_SIDE = 32767
"""Largest width and height (cells): planners' queues pack row and column into 32 bits."""
MOST_CELLS = 1 << 28
"""Largest number of cells: 800 m x 800 m at 5 cm; costmap and planner take ten bytes for each."""

LARGEST_MAP_FILE = 1 << 20
"""Largest size (bytes) of a map's YAML file."""
IMAGE_FORMATS = ("PNG", "PPM", "BMP", "GIF", "JPEG", "PCX", "TGA", "TIFF", "WEBP")
"""Formats that map_server (SDL_image) and Pillow read. Not EPS: Pillow would start Ghostscript on the file."""
BAND = 1 << 22
"""Pixels of an image that are converted at a time, to limit memory."""
PLAIN_HEAD = re.compile(rb"P5\s(?:\s|#[^\r\n]*[\r\n])*([0-9]{1,9})\s+([0-9]{1,9})\s+255\s")
"""Header of a binary PGM image with 8 bits a pixel: comments, width and height."""
LONGEST_HEAD = 4096
"""Bytes in which the header must end."""
_PILLOW = threading.Lock()

FREE = 0
OCCUPIED = 100
UNKNOWN = -1
CHECK_THRESHOLDS = "check its image, and free_thresh, occupied_thresh and negate in its YAML file"
"""What to do about a map in which no cell is free."""


def too_large(width: int, height: int, what: str = "cells") -> str:
    """Return how large a map is and what is taken, for the end of a message; empty where a map may be so large."""
    if max(width, height) <= LARGEST_SIDE and width * height <= MOST_CELLS:
        return ""
    return f"{width} x {height} {what}; at most {LARGEST_SIDE} each way and {MOST_CELLS} in all are taken"


class MapFileError(ValueError):
    """A map's YAML file is missing something or holds a wrong value; the text names file, key and value."""


class MapImageError(ValueError):
    """A map's image cannot be read; the text names it."""


@dataclass(frozen=True)
class OccupancyMap:
    """A map of a floor.

    Attributes:
        data: Shape (height, width), int8: 0 free to 100 occupied, -1 unknown; row 0 is the lowest y.
        resolution: Side of a cell in metres.
        origin: Pose of the lower left corner in the map's frame; theta may turn the whole map.
    """

    data: np.ndarray
    resolution: float
    origin: Pose2D

    @property
    def local_grid(self) -> Grid:
        """The map's grid in the frame of its origin, with which it is aligned."""
        height, width = self.data.shape
        return Grid(self.resolution, 0.0, 0.0, width, height)

    @property
    def upright_grid(self) -> Grid:
        """A grid along the axes of the map's frame: the map's own, or the bounding box of a turned map."""
        height, width = self.data.shape
        if self.origin.theta == 0.0:
            return Grid(self.resolution, self.origin.x, self.origin.y, width, height)
        corners = np.array([(0, 0), (width, 0), (0, height), (width, height)]) * self.resolution
        corners = self.origin.transform_points(corners)
        left, bottom = corners.min(axis=0).tolist()
        columns, rows = np.ceil(np.ptp(corners, axis=0) / self.resolution - 1e-6).astype(int).tolist()
        return Grid(self.resolution, left, bottom, columns, rows)

    def is_same(self, other: OccupancyMap) -> bool:
        """Return whether another map has the same cells, resolution and origin."""
        return (self.resolution, self.origin) == (other.resolution, other.origin) and np.array_equal(
            self.data, other.data)

    def contains_point(self, x: float, y: float) -> bool:
        """Return whether a point of the map's frame (m) lies on the map."""
        local = Pose2D(x, y, 0.0).relative_to(self.origin)
        return self.local_grid.contains_point(local.x, local.y)


@dataclass(frozen=True)
class MapFileParameters(ParameterSet):
    """Entries of a map's YAML file (map_server's format)."""

    image: str = parameter("", "file of the image, absolute or relative to the YAML file")
    resolution: float = parameter(
        0.05, "side length of a cell", unit="m", minimum=FINEST, maximum=COARSEST, clamped=False)
    origin: Tuple[float, float, float] = parameter(
        (0.0, 0.0, 0.0), "pose of the lower left corner: x (m), y (m), yaw (rad)")
    negate: bool = parameter(False, "swap black and white: white is occupied")
    occupied_thresh: float = parameter(
        0.65, "pixels darker than this share of black are occupied", minimum=0.0, maximum=1.0)
    free_thresh: float = parameter(0.196, "pixels lighter than this share of black are free", minimum=0.0, maximum=1.0)
    mode: str = parameter(
        "trinary", "how pixels become occupancy, as in map_server", choices=("trinary", "scale", "raw"))

    REQUIRED = ("image", "resolution", "origin", "negate", "occupied_thresh", "free_thresh")

    def check(self) -> None:
        if not self.image:
            raise ValueError("parameter image is empty; it must name the map's image file")
        if not Pose2D(*self.origin).is_finite():
            raise ValueError(f"parameter origin is {self.origin}; it must be finite")


def load_map(yaml_path: str) -> OccupancyMap:
    """Read a map from its YAML file and the image named in it.

    Raises:
        OSError: The YAML file or the image cannot be opened.
        MapFileError: The YAML file lacks a key or has a wrong value.
        MapImageError: The image cannot be read, or is too large.
    """
    parameters = read_map_file(yaml_path)
    image_path = os.path.join(os.path.dirname(os.path.abspath(yaml_path)), parameters.image)
    return load_map_image(image_path, parameters)


def read_map_file(yaml_path: str) -> MapFileParameters:
    """Read and check a map's YAML file; errors as for `load_map`."""
    try:
        values = files.parse_yaml(files.read_text(yaml_path, LARGEST_MAP_FILE))
    except ValueError as error:
        raise MapFileError(f"map file {yaml_path} is no YAML: {error}") from error
    if not isinstance(values, dict):
        raise MapFileError(f"map file {yaml_path} holds no keys; it must have {', '.join(MapFileParameters.REQUIRED)}")
    missing = [name for name in MapFileParameters.REQUIRED if name not in values]
    if missing:
        raise MapFileError(f"map file {yaml_path} lacks {', '.join(missing)}")
    try:
        return MapFileParameters.from_mapping({name: _plain(name, value) for name, value in values.items()})
    except ValueError as error:
        raise MapFileError(f"map file {yaml_path}: {error}") from error


def _plain(name: str, value: Any) -> Any:
    """Return a YAML value as map_server reads it: `negate: 0` is a bool, and 5e-2 a number, not a string."""
    if isinstance(value, str) and name not in ("image", "mode"):
        try:
            value = float(value)
        except ValueError:
            return value
    if name == "negate" and value in (0, 1):
        return bool(value)
    if name == "origin" and isinstance(value, list):
        numbers = [_plain("", entry) for entry in value]
        if len(numbers) == 3 and isinstance(numbers[2], float) and math.isnan(numbers[2]):
            numbers[2] = 0.0  # an old map_saver's: it wrote so of maps that were not turned
        return numbers
    return value


def load_map_image(image_path: str, parameters: MapFileParameters) -> OccupancyMap:
    """Read a map from its image.

    Raises:
        OSError: The file cannot be opened.
        MapImageError: It cannot be read as an image, is too large, or has no pixel.
    """
    try:
        file = files.open_regular(image_path, MOST_CELLS * 8)
    except ValueError as error:
        raise MapImageError(f"map image {error}") from error
    with file:
        plain = _read_plain(file, parameters)
        if plain is not None:
            return OccupancyMap(plain, parameters.resolution, Pose2D(*parameters.origin))
        from PIL import Image

        try:
            return OccupancyMap(
                _read_image(file, parameters), parameters.resolution, Pose2D(*parameters.origin))
        except (OSError, ValueError, SyntaxError, struct.error, EOFError, Image.DecompressionBombError) as error:
            raise MapImageError(f"map image {image_path} cannot be read: {error}") from error


def _read_plain(file: BinaryIO, parameters: MapFileParameters) -> Optional[np.ndarray]:
    """Return the occupancy of a PGM file like map_saver's; None for other files, and for too short or too large ones.

    Such maps, which most are, need no Pillow, which takes 3 MiB of the process.
    """
    match = PLAIN_HEAD.match(file.read(LONGEST_HEAD))
    width, height = map(int, match.groups()) if match else (0, 0)
    begin = match.end() if match else 0
    is_whole = 0 < width * height <= file.seek(0, os.SEEK_END) - begin
    if not is_whole or too_large(width, height):
        file.seek(0)
        return None
    file.seek(begin)
    rows = max(1, BAND // width)
    data = np.empty((height, width), dtype=np.int8)
    for top in range(0, height, rows):
        bottom = min(top + rows, height)
        band = np.frombuffer(file.read((bottom - top) * width), dtype=np.uint8)
        data[height - bottom:height - top] = _occupancy(band.reshape(bottom - top, width, 1), parameters)
    return data


def _read_image(file: BinaryIO, parameters: MapFileParameters) -> np.ndarray:
    """Return the occupancy of an image, int8, row 0 the lowest y.

    Converted in bands of rows, since a large image would take gigabytes at once.
    """
    from PIL import Image

    with warnings.catch_warnings():
        # Pillow's own limit, 178.9 megapixels, is below the largest map; ours is looked at before anything is unpacked.
        warnings.simplefilter("ignore", Image.DecompressionBombWarning)
        with _any_size():
            image = Image.open(file)
            if image.format not in IMAGE_FORMATS:
                raise ValueError(f"it is {image.format}; maps are {', '.join(IMAGE_FORMATS)}")
            width, height = image.size
            trouble = too_large(width, height, "pixels") if width * height else "no pixel"
            if trouble:
                raise ValueError(f"it has {trouble}")
            image.load()
    deep = image.mode.startswith("I") or image.mode == "F"  # scaled by the highest value of the whole image
    rows = height if deep else max(1, BAND // width)
    data = np.empty((height, width), dtype=np.int8)
    for top in range(0, height, rows):
        bottom = min(top + rows, height)
        band = image if rows >= height else image.crop((0, top, width, bottom))
        band.info = image.info
        data[height - bottom:height - top] = _occupancy(_channels(band), parameters)
    return data


@contextlib.contextmanager
def _any_size() -> Iterator[None]:
    """Switch off Pillow's limit of pixels, a global variable of its module, while an image is opened."""
    from PIL import Image

    with _PILLOW:
        limit, Image.MAX_IMAGE_PIXELS = Image.MAX_IMAGE_PIXELS, None
        try:
            yield
        finally:
            Image.MAX_IMAGE_PIXELS = limit


def _channels(image: Image.Image) -> np.ndarray:
    """Return an image as uint8 of shape (height, width, channels), channels 1, 3 or 4 with alpha last."""
    if image.mode.startswith("I") or image.mode == "F":
        values = np.asarray(image)
        if not np.isfinite(values).all() or np.abs(values).max() > np.iinfo(np.int32).max:
            raise ValueError("it has pixels that are no numbers, or larger than any image's")
        values = values.astype(np.int64)
        return (values >> 8 if values.size and values.max() > 255 else values).astype(np.uint8)[:, :, None]
    if image.mode in ("LA", "PA", "RGBA") or "transparency" in image.info:
        return np.asarray(image.convert("RGBA"))
    if image.mode in ("L", "1"):
        return np.asarray(image.convert("L"))[:, :, None]
    return np.asarray(image.convert("RGB"))


def _occupancy(channels: np.ndarray, parameters: MapFileParameters) -> np.ndarray:
    """Turn pixels into occupancy, int8 with row 0 the lowest y (map_server's image_loader)."""
    has_alpha = channels.shape[2] == 4
    # In trinary mode the alpha channel counts as one more colour; existing maps were made to look right that way.
    counted = channels if parameters.mode == "trinary" or not has_alpha else channels[:, :, :3]
    count = counted.shape[2]
    values = _value_table(count, parameters)[counted.sum(axis=2, dtype=np.int64)]
    if parameters.mode == "scale" and has_alpha:
        between = (values > 0) & (values < 100)
        values = np.where(between & (channels[:, :, 3] == 0), np.int8(UNKNOWN), values)
    return np.ascontiguousarray(values[::-1])


def _value_table(count: int, parameters: MapFileParameters) -> np.ndarray:
    """Return the occupancy (int8) for every sum that `count` channels of 0 to 255 can have."""
    average = np.arange(255 * count + 1) / count
    if parameters.negate:
        average = 255.0 - average
    if parameters.mode == "raw":
        return average.astype(np.uint8).view(np.int8)
    share = (255.0 - average) / 255.0
    table = np.full(len(share), UNKNOWN, dtype=np.int8)
    if parameters.mode == "scale":
        span = max(parameters.occupied_thresh - parameters.free_thresh, 1e-12)
        table = np.clip(1.0 + 98.0 * (share - parameters.free_thresh) / span, 1, 99).astype(np.int8)
    table[share < parameters.free_thresh] = FREE
    table[share > parameters.occupied_thresh] = OCCUPIED  # last, as in map_server: it wins where thresholds cross
    return table


def save_map(stem: str, occupancy: OccupancyMap, occupied: int = 65, free: int = 25) -> Tuple[str, str]:
    """Write a map as STEM.pgm and STEM.yaml in map_saver's form.

    Args:
        stem: Path without ending.
        occupancy: The map.
        occupied: Cells of at least this value are written black (occupied).
        free: Cells from 0 to this value are written white (free); all others grey (unknown).

    Returns:
        Paths of the YAML file and the image.

    Raises:
        OSError: A file cannot be written.
        ValueError: The thresholds contradict each other.
    """
    if not (0 <= free < occupied <= 100):
        raise ValueError(f"thresholds are occ {occupied} and free {free}; they must be 0 <= free < occ <= 100")
    image_path, yaml_path = stem + ".pgm", stem + ".yaml"
    data = occupancy.data[::-1]
    pixels = np.full(data.shape, 205, dtype=np.uint8)
    pixels[(data >= 0) & (data <= free)] = 254
    pixels[data >= occupied] = 0
    height, width = data.shape
    with whole_file(image_path) as file:
        file.write(f"P5\n# {occupancy.resolution:.3f} m/pix\n{width} {height}\n255\n".encode())
        file.write(pixels.tobytes())
    origin = ", ".join(repr(float(value)) for value in occupancy.origin)
    write_whole(  # the image stands beside the YAML file, so its name alone finds it from any working directory
        yaml_path,
        f"image: {yaml.safe_dump(os.path.basename(image_path), width=math.inf).splitlines()[0]}\n"
        f"resolution: {occupancy.resolution!r}\norigin: [{origin}]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.196\n\n",
    )
    return yaml_path, image_path
