"""Atomic writing of files."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path
from typing import BinaryIO, Iterator, Union


@contextlib.contextmanager
def whole_file(path: Union[str, Path]) -> Iterator[BinaryIO]:
    """Open a file for writing under a temporary name; it replaces `path` when the block ends without an exception.

    Otherwise, as with a full disk, the former file stays as it was. A path that is no regular file, such as a terminal
    or a pipe, is written directly.

    Args:
        path: The file.

    Yields:
        The open binary file.

    Raises:
        OSError: The file cannot be written; the error names it, also where the system's does not (full disk).
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
    """Write a text (as UTF-8) or bytes to a file; errors as for `whole_file`."""
    with whole_file(path) as stream:
        stream.write(content if isinstance(content, bytes) else content.encode("utf-8"))
