"""Compile the package's kernels ahead, or fill numba's cache where that cannot be done.

usage: python -m mbf_relay.kernel_build [FOLDER] --objects FOLDER [--compiler CC]
"""

from __future__ import annotations

import argparse
import hashlib
import importlib.util
import json
import os
import platform
import subprocess
import sys
import sysconfig
from concurrent.futures import ProcessPoolExecutor
from importlib.metadata import version
from multiprocessing import get_context
from pathlib import Path
from typing import Dict, List

from mbf_relay import kernels
from mbf_relay.kernel_build.kernel_objects import KernelEntry, compile_module, environment, features_of
from mbf_relay.kernel_build.wrappers import module_source
from mbf_relay.whole_files import write_whole

MOST_PROCESSES = 4
"""Each takes 200 MiB."""
HERE = Path(__file__).parent


def main() -> None:
    """Build the module, and say in one line what came of it."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument(
        "folder", type=Path, nargs="?", help="where the module goes; without it only what it is linked from is made"
    )
    parser.add_argument("--objects", type=Path, required=True, help="where what is compiled is kept for the next time")
    parser.add_argument("--compiler", default="cc", help="of C")
    arguments = parser.parse_args()
    if arguments.folder is None:
        _compile(_sources(), arguments.objects)
        return
    try:
        place = build(arguments.folder, arguments.objects, arguments.compiler)
    except Exception as error:  # whatever a compiler, a header or another numba lacks: nodes can do without
        said = getattr(error, "stderr", None) or str(error)
        print(f"kernels cannot be compiled ahead: {said.strip()[:400]}", file=sys.stderr)
        print("nodes will compile them by themselves, which takes 100 MiB of each", file=sys.stderr)
        kernels.compile_all()
    else:
        print(f"compiled kernels: {place}")


def build(folder: Path, objects: Path, compiler: str) -> Path:
    """Make the extension module and return its path.

    Args:
        folder: Where it goes.
        objects: Where object files are kept from one time to the next.
        compiler: The C compiler's command.

    Raises:
        Exception: It cannot be made; a CalledProcessError has the compiler's words.
    """
    folder.mkdir(parents=True, exist_ok=True)
    sources = _sources()
    entries = _compile(sources, objects)
    wrappers = objects / "wrappers.c"
    wrappers.write_text((HERE / "support.c").read_text() + module_source(entries, sources), encoding="utf-8")
    import numpy

    made_of = [str(_object(objects, sources, name, each)) for name in sources for each in features_of(name)]
    target = folder / ("_kernels" + str(sysconfig.get_config_var("EXT_SUFFIX")))
    made = objects / target.name
    subprocess.run(
        [
            compiler, "-O2", "-shared", "-fPIC", "-fvisibility=hidden", "-Wl,-s",
            "-I", sysconfig.get_paths()["include"], "-I", numpy.get_include(),
            str(wrappers), *made_of, "-lm", "-o", str(made),
        ],
        check=True, capture_output=True, text=True,
    )
    _require_loadable(made)
    staged = target.with_suffix(f".{os.getpid()}")  # beside it, so that a node that starts now finds one or the other
    staged.write_bytes(made.read_bytes())
    staged.replace(target)
    return target


def _require_loadable(path: Path) -> None:
    """Load an extension module in another process; what it lacks would else be found out by nodes, and only said there.

    Raises:
        subprocess.CalledProcessError: It cannot be loaded.
    """
    program = (
        "import sys\n"
        "from importlib.util import module_from_spec, spec_from_file_location\n"
        "try: module_from_spec(spec_from_file_location('mbf_relay._kernels', sys.argv[1]))\n"
        "except ImportError as error: sys.exit(str(error))"
    )
    subprocess.run([sys.executable, "-c", program, str(path)], check=True, capture_output=True, text=True)


def _compile(sources: Dict[str, str], objects: Path) -> Dict[str, List[List[KernelEntry]]]:
    """Make the object files that are not there, and return what is in all of them.

    Args:
        sources: Digest of the source by name of the module.
        objects: Folder of object files, made where it is not there; beside each a .json file tells what is in it.

    Returns:
        By name of the module a list for each kernel: itself for any processor, then for those of each feature.

    Raises:
        Exception: A module cannot be compiled.
    """
    objects.mkdir(parents=True, exist_ok=True)
    found: Dict[str, List[List[KernelEntry]]] = {name: [] for name in sources}
    for features in sorted({each for name in sources for each in features_of(name)}):
        places = {name: _object(objects, sources, name, features) for name in sources if features in features_of(name)}
        missing = [name for name in places if not places[name].with_suffix(".json").exists()]
        missing.sort(key=lambda name: -Path(_source_of(name)).stat().st_size)  # what takes long does not come last
        os.environ.update(environment(features))
        processes = max(1, min(MOST_PROCESSES, os.cpu_count() or 1, len(missing)))
        with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
            paths = [str(places[name]) for name in missing]
            for path, entries in zip(paths, pool.map(compile_module, missing, paths, [features] * len(missing))):
                write_whole(Path(path).with_suffix(".json"), json.dumps(entries))
        for name, place in places.items():
            texts = json.loads(place.with_suffix(".json").read_text("utf-8"))
            found[name].append([KernelEntry(*entry) for entry in texts])
    return {name: [list(same) for same in zip(*entries)] for name, entries in found.items()}


def _object(objects: Path, sources: Dict[str, str], name: str, features: str) -> Path:
    """Return where a module's object file is: another one for each state of its source, compiler and processor."""
    made_by = kernels.digest(str(HERE / "kernel_objects.py"))
    state = sources[name] + made_by + sys.version + version("numba") + platform.machine() + features
    key = hashlib.sha256(state.encode()).hexdigest()[:16]
    return objects / f"{name}-{key}.o"


def _sources() -> Dict[str, str]:
    """Return the digest of each kernel module's source."""
    return {name: kernels.digest(_source_of(name)) for name in kernels.module_names()}


def _source_of(name: str) -> str:
    found = importlib.util.find_spec(name)
    assert found is not None and found.origin is not None
    return found.origin


if __name__ == "__main__":
    main()
