"""Which layers of a costmap take what one sensor sees."""

from __future__ import annotations

from typing import Any, Dict, Iterable, List, Tuple

from mbf_relay.costmap.layer import Layer


def inputs_of(layers: Iterable[Layer]) -> Dict[str, List[Tuple[Layer, str]]]:
    """Return which layers take what each sensor sees, and what they call it, by the sensors' names.

    Layers that give one name to what comes on one topic share it. A name that an earlier layer has for another topic
    is told as LAYER/NAME.
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
    return bool((source.topic, source.data_type) == (other.topic, other.data_type))
