"""Files that are written whole or not at all."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path
from typing import BinaryIO, Iterator, Union


@contextlib.contextmanager
def whole_file(path: Union[str, Path]) -> Iterator[BinaryIO]:
    """Open a file to write that takes its place once all of it is there.

    Where the disk is full, what stood there before stays as it was. What is no regular file, such as a terminal or a
    pipe, is written to as it comes.

    Args:
        path: Of the file.

    Yields:
        Where the bytes go.

    Raises:
        OSError: It cannot be written; it names the file, which the system's own error of a full disk does not.
    """
    in_place = os.path.exists(path) and not os.path.isfile(path)
    place = os.path.realpath(path)  # a link stays one
    partial = str(path) if in_place else f"{place}.{os.getpid()}.partial"
    try:
        with open(partial, "wb") as stream:
            yield stream
        if not in_place:
            os.replace(partial, place)
    except BaseException as error:
        if not in_place:
            with contextlib.suppress(OSError):
                os.remove(partial)
        if isinstance(error, OSError) and error.errno and error.filename in (None, partial):
            raise OSError(error.errno, error.strerror, str(path)) from error
        raise


def write_whole(path: Union[str, Path], content: Union[str, bytes]) -> None:
    """Write a file of a text or of bytes; errors as for `whole_file`."""
    with whole_file(path) as stream:
        stream.write(content if isinstance(content, bytes) else content.encode("utf-8"))
