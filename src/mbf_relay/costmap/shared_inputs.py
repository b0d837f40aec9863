"""Which layers of a costmap share an observation source."""

from __future__ import annotations

from typing import Any, Dict, Iterable, List, Tuple

from mbf_relay.costmap.layer import Layer

READ_BY = ("topic", "data_type", "sensor_frame", "inf_is_valid", "largest_gap", "observation_persistence")
"""Parameters that must agree for layers to share a source; they say how its messages are received and converted."""


def inputs_of(layers: Iterable[Layer]) -> Dict[str, List[Tuple[Layer, str]]]:
    """Return the layers that take each source, each with its own name for it, by the source's name in the costmap.

    Layers whose sources agree in name and in READ_BY share one. Where an earlier layer uses the name for another
    source, the name in the costmap is LAYER/NAME.
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
