"""Which layers of a costmap take what one sensor sees."""

from __future__ import annotations

from typing import Any, Dict, Iterable, List, Tuple

from mbf_relay.costmap.layer import Layer

READ_BY = ("topic", "data_type", "sensor_frame", "inf_is_valid", "largest_gap", "observation_persistence")
"""Parameters of a sensor that its messages are taken and read by; the others each layer keeps to by itself."""


def inputs_of(layers: Iterable[Layer]) -> Dict[str, List[Tuple[Layer, str]]]:
    """Return which layers take what each sensor sees, and what they call it, by the sensors' names.

    Layers that give one name to what comes on one topic, and read it alike, share it. A name that an earlier layer has
    for something else is told as LAYER/NAME.
    """
    result: Dict[str, List[Tuple[Layer, str]]] = {}
    for layer in layers:
        for name, source in layer.sources.items():
            alike = (key for key, [(other, theirs), *_] in result.items()
                     if theirs == name and _comes_with(source, other.sources[theirs]))
            key = next(alike, f"{layer.name}/{name}" if name in result else name)
            result.setdefault(key, []).append((layer, name))
    return result


def _comes_with(source: Any, other: Any) -> bool:
    return all(getattr(source, name) == getattr(other, name) for name in READ_BY)
