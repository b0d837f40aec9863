"""A measured metric, how one is taken, and the machine it was taken on."""

from __future__ import annotations

import dataclasses
import importlib
import math
import os
import platform
import time
from typing import Any, Callable, Dict, Mapping, Optional, Sequence

import numpy as np


class NotMeasurable(Exception):
    """A benchmark lacks something on this machine, such as data that is not part of the package; the text says what."""


@dataclasses.dataclass(frozen=True)
class Metric:
    """One measured metric.

    Attributes:
        name: What was measured, e.g. "plan 384 x 384, empty".
        value: The metric to quote; the median where it was taken several times.
        unit: Unit of `value`, `median` and `p95`, e.g. "ms"; empty for a plain number.
        median: Median over the repeats; `value` where None.
        p95: 95th percentile over the repeats; None where there is no spread to speak of.
        repeats: How often it was taken.
        parameters: What it depends on, by name.
    """

    name: str
    value: float
    unit: str = ""
    median: Optional[float] = None
    p95: Optional[float] = None
    repeats: int = 1
    parameters: Mapping[str, Any] = dataclasses.field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.median is None:
            object.__setattr__(self, "median", self.value)
        if self.repeats < 1:
            raise ValueError(f"metric '{self.name}' was taken {self.repeats} times; it must be at least once")

    def as_dict(self) -> Dict[str, Any]:
        """Return the fields by name, fit for JSON."""
        return dataclasses.asdict(self)


def metric_of(name: str, samples: Sequence[float], unit: str, **parameters: Any) -> Metric:
    """Return the metric whose value is the median of `samples`."""
    values = np.asarray(samples, dtype=float)
    median, p95 = (float(value) for value in np.percentile(values, [50.0, 95.0]))
    return Metric(name, median, unit, median, p95 if len(values) > 1 else None, len(values), parameters)


def time_call(
    name: str, call: Callable[[], Any], repeats: int, unit: str = "ms", warm_up: int = 1, **parameters: Any
) -> Metric:
    """Measure how long `call` takes.

    Args:
        name: Name of the metric.
        call: What to measure.
        repeats: How often to measure.
        unit: "s", "ms" or "us".
        warm_up: Calls before the first that counts.
        parameters: What the metric depends on.
    """
    scale = {"s": 1.0, "ms": 1e3, "us": 1e6}[unit]
    for _ in range(warm_up):
        call()
    samples = []
    for _ in range(repeats):
        start = time.perf_counter()
        call()
        samples.append((time.perf_counter() - start) * scale)
    return metric_of(name, samples, unit, **parameters)


def describe_machine() -> Dict[str, Any]:
    """Return what the metrics depend on besides their parameters: processor, memory, system and library versions."""
    return {
        "processor": _from_file("/proc/cpuinfo", "model name") or platform.processor() or platform.machine(),
        "cores": os.cpu_count(),
        "memory_gib": round(_memory_bytes() / 2**30, 1),
        "system": _from_file("/etc/os-release", "PRETTY_NAME", "=") or platform.platform(),
        "python": platform.python_version(),
        **{module: _version(module) for module in ("numpy", "numba", "pybullet")},
    }


def _from_file(path: str, key: str, separator: str = ":") -> Optional[str]:
    try:
        with open(path, encoding="utf-8") as lines:
            for line in lines:
                name, _, value = line.partition(separator)
                if name.strip() == key:
                    return value.strip().strip('"')
    except OSError:
        pass
    return None


def _memory_bytes() -> int:
    return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")


def _version(module: str) -> Optional[str]:
    """Return a library's version, None where it is not installed."""
    try:
        imported = importlib.import_module(module)
    except ImportError:
        return None
    return getattr(imported, "__version__", None) or _distribution_version(module)


def _distribution_version(module: str) -> Optional[str]:
    from importlib import metadata

    try:
        return metadata.version(module)
    except metadata.PackageNotFoundError:
        return "of unknown version"


def round_for_people(value: Optional[float]) -> str:
    """Return a number with three or four significant digits, "-" where there is none."""
    if value is None or not math.isfinite(value):
        return "-"
    if value == 0 or (float(value).is_integer() and abs(value) < 1e6):
        return f"{value:.0f}"
    digits = max(0, 2 - int(np.floor(np.log10(abs(value)))))
    return f"{value:.{digits}f}"


def machine_line(machine: Mapping[str, Any]) -> str:
    """Return one sentence about the machine `describe_machine` described."""
    libraries = ", ".join(f"{name} {machine[name]}" for name in ("numpy", "numba", "pybullet") if machine[name])
    return (
        f"Measured on {machine['processor']}, {machine['cores']} cores, {machine['memory_gib']} GiB, "
        f"{machine['system']}, Python {machine['python']}, {libraries}."
    )


def table(metrics: Sequence[Metric]) -> str:
    """Return metrics as a Markdown table."""
    rows = [("metric", "median", "p95", "unit", "repeats", "parameters")]
    for metric in metrics:
        parameters = ", ".join(f"{name}={value}" for name, value in metric.parameters.items())
        rows.append(
            (
                metric.name, round_for_people(metric.value), round_for_people(metric.p95), metric.unit or "-",
                str(metric.repeats), parameters or "-",
            )
        )
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    lines = ["| " + " | ".join(cell.ljust(width) for cell, width in zip(row, widths)) + " |" for row in rows]
    lines.insert(1, "|" + "|".join("-" * (width + 2) for width in widths) + "|")
    return "\n".join(lines)
