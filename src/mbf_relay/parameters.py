"""Declared parameters: frozen dataclasses whose fields carry unit, range and meaning, checked when made.

    class AnyParameters(ParameterSet):
        "Parameters of ..."
        sim_time: float = parameter(1.5, "how far trajectories reach", unit="s", above=0.0)
        max_vel_x: float = parameter(0.22, "top forward speed", unit="m/s", aliases=("max_trans_vel_x",))

Decorate with `@dataclass(frozen=True)`. `from_mapping` fills such a class from a node's YAML or from the parameter
server.
"""

from __future__ import annotations

import dataclasses
import math
import re
import typing
from typing import Any, ClassVar, Dict, Iterable, List, Mapping, Optional, Sequence, Tuple, Type, TypeVar

from mbf_relay.misspelling import did_you_mean, nearest_of

T = TypeVar("T", bound="ParameterSet")

LARGEST = 1e9
"""Bound of numbers without a narrower one, in any unit: 30 years, a million kilometres. Larger ones, infinity included,
would overflow when squared or converted to cells."""
FAR_BEYOND = 10 ** 18
"""Integers beyond it are replaced by it: it is out of every range as well, and can be converted to a float."""
SPEED_UNITS = ("m/s", "rad/s")
"""Units of parameters refused beyond LARGEST instead of clamped: such a value means that no limit is wanted."""
TOPIC = re.compile(r"[~/a-zA-Z][\w/]*", re.ASCII)
"""Pattern of a topic's name."""
SWITCHES = {True: ("true", "yes", "on", "1", "1.0"), False: ("false", "no", "off", "0", "0.0")}
"""Spellings of booleans, YAML's words and numbers, in lower case."""


def parameter(
    default: Any,
    description: str,
    unit: str = "",
    minimum: Optional[float] = None,
    maximum: Optional[float] = None,
    above: Optional[float] = None,
    choices: Optional[Sequence[Any]] = None,
    aliases: Sequence[str] = (),
    clamped: bool = True,
    else_default: bool = False,
    is_frame: bool = False,
    is_topic: bool = False,
    *,
    has_effect: bool = True,
) -> Any:
    """Declare a parameter as a dataclass field.

    Args:
        default: Value where none is given.
        description: What it does, one line.
        unit: SI unit, empty for none.
        minimum, maximum: Allowed range, both included.
        above: Lower bound that is itself not allowed.
        choices: The allowed values.
        aliases: Older names still read, with one warning.
        clamped: Whether a user's value out of range is clamped to it; False where it is refused, as a guess could be
            dangerous.
        else_default: Whether a text that is none of the choices stands for the default, as upstream.
        is_frame: Whether it names a frame; the leading slash of tf's names is removed, as for tf2.
        is_topic: Whether it names a topic, and cannot be empty.
        has_effect: False for a parameter that has an effect upstream only; see `without_effect`.
    """
    metadata = dict(
        description=description, unit=unit, minimum=minimum, maximum=maximum, above=above, choices=choices,
        aliases=tuple(aliases), clamped=clamped, else_default=else_default, is_frame=is_frame, is_topic=is_topic,
        has_effect=has_effect, largest=math.inf if default == math.inf else LARGEST,
    )
    if isinstance(default, (list, dict)):
        return dataclasses.field(default_factory=lambda: type(default)(default), metadata=metadata)
    return dataclasses.field(default=default, metadata=metadata)


def without_effect(default: Any, why: str, *arguments: Any, **options: Any) -> Any:
    """Declare a parameter that has an effect upstream but none here, and say why; otherwise as `parameter`."""
    return parameter(default, f"read, and without effect: {why}", *arguments, has_effect=False, **options)


@dataclasses.dataclass(frozen=True)
class ParameterSet:
    """Base of all parameter dataclasses: validates every field when made.

    Attributes:
        ORDERED: Pairs of numbers of which the first must not be above the second.

    Raises:
        ValueError: Naming the parameter, its value and what is allowed.
    """

    ORDERED: ClassVar[Tuple[Tuple[str, str], ...]] = ()

    def __post_init__(self) -> None:
        hints = _hints(type(self))
        for field in dataclasses.fields(self):
            value = convert(field.name, getattr(self, field.name), hints[field.name])
            _check_range(field.name, value, field.metadata)
            if field.metadata.get("is_topic") and not TOPIC.fullmatch(value):
                raise ValueError(
                    f"parameter {field.name} is {value!r}; it must be a topic's name: a letter, / or ~, then letters, "
                    "digits, _ and /")
            if field.metadata.get("is_frame"):
                value = value.lstrip("/")
            object.__setattr__(self, field.name, value)
        for low, high in self.ORDERED:
            if getattr(self, low) > getattr(self, high):
                raise ValueError(
                    f"parameter {low} is {getattr(self, low)}; it must be at most {high}, which is "
                    f"{getattr(self, high)}"
                )
        self.check()

    def check(self) -> None:
        """Check what involves several parameters; raise ValueError. Override where there is such a thing."""

    def read_as(self) -> List[str]:
        """Return a line for each valid value that is used otherwise than written. Override where there are such."""
        return []

    @classmethod
    def from_mapping(cls: Type[T], values: Mapping[str, Any]) -> T:
        """Create a set from names and values; unknown names are ignored (see `unknown_names`)."""
        return cls(**cls.known(values))

    @classmethod
    def read(cls: Type[T], values: Mapping[str, Any]) -> Tuple[T, List[str]]:
        """Create a set from a user's values, and return it with notes on the values that were changed.

        As by dynamic_reconfigure, numbers out of range are clamped to the nearer bound; without one the default is
        used, as it is for what is no value of a parameter without effect. Of an ORDERED pair in the wrong order the
        lower one is reduced, where the higher one is not negative.

        Raises:
            ValueError: A value that has an effect is of the wrong type, or contradicts others.
        """
        return _read(cls, cls.known(values), cls._written(values))

    @classmethod
    def known(cls, values: Mapping[str, Any]) -> Dict[str, Any]:
        """Return the values of this set's parameters by their present names, which take precedence over aliases."""
        return {name: values[written] for name, written in cls._written(values).items()}

    @classmethod
    def _written(cls, values: Mapping[str, Any]) -> Dict[str, str]:
        """Return for each present name the name used in `values`, itself or an alias."""
        result: Dict[str, str] = {}
        for field in dataclasses.fields(cls):
            for name in (field.name,) + tuple(field.metadata.get("aliases", ())):
                if name in values:
                    result[field.name] = name
                    break
        return result

    @classmethod
    def unknown_names(cls, values: Mapping[str, Any]) -> List[str]:
        """Return the names in `values` that are neither parameters, nor aliases, nor known groups (see `groups`)."""
        names = {*cls.names(), *cls.groups(values)}
        for field in dataclasses.fields(cls):
            names.update(field.metadata.get("aliases", ()))
        return [name for name in values if name not in names]

    @classmethod
    def groups(cls, values: Mapping[str, Any]) -> Iterable[str]:
        """Return the names under which a group of further parameters is read. Override where there are such."""
        return ()

    def set_in_vain(self) -> Dict[str, str]:
        """Return the parameters without effect that are not at their defaults, each with its description."""
        return {
            field.name: field.metadata["description"] for field in dataclasses.fields(self)
            if not field.metadata.get("has_effect", True) and getattr(self, field.name) != field.default
        }

    @classmethod
    def deprecated_names(cls, values: Mapping[str, Any]) -> Dict[str, str]:
        """Return the older names used in `values`, each with the present name."""
        return {
            alias: field.name
            for field in dataclasses.fields(cls)
            for alias in field.metadata.get("aliases", ())
            if alias in values
        }

    @classmethod
    def names(cls) -> List[str]:
        """Return the names of the parameters."""
        return [field.name for field in dataclasses.fields(cls)]

    @classmethod
    def types(cls) -> Dict[str, Any]:
        """Return the declared type of each parameter by its name."""
        hints = _hints(cls)
        return {name: hints[name] for name in cls.names()}

    @classmethod
    def hint(cls, name: str) -> str:
        """Return the end of a message about the unknown `name`; empty where no parameter looks like it."""
        return did_you_mean(nearest_of(name, cls.names()))

    def replace(self: T, **changes: Any) -> T:
        """Return a copy with some parameters changed, validated anew."""
        return dataclasses.replace(self, **changes)

    def reconfigured(self: T, changes: Mapping[str, Any]) -> Tuple[T, List[str]]:
        """Return a copy with changes made at run time, and notes on other values changed with them.

        If a maximum is lowered below its minimum, so is the minimum: a request to drive slower is not refused.

        Raises:
            ValueError: A value is out of range, or contradicts others.
        """
        given, notes = dict(changes), []
        for low, high in self.ORDERED:
            highest = given.get(high, math.nan)
            if low not in changes and getattr(self, low) > highest >= 0.0:
                notes.append(f"parameter {low} is {getattr(self, low)}; it must be at most {high}: {highest} is used")
                given[low] = highest
        return self.replace(**given), notes

    def as_dict(self) -> Dict[str, Any]:
        """Return names and values."""
        return dataclasses.asdict(self)


def _hints(cls: type) -> Dict[str, Any]:
    """Return the annotated types of a class, cached: get_type_hints is slow, and a drive creates dozens of sets."""
    if cls not in _known_hints:
        _known_hints[cls] = typing.get_type_hints(cls)
    return _known_hints[cls]


_known_hints: Dict[type, Dict[str, Any]] = {}


def _read(cls: Type[T], known: Dict[str, Any], written: Mapping[str, str]) -> Tuple[T, List[str]]:
    """Do what `ParameterSet.read` does.

    Args:
        cls: Class of the set.
        known: Values by present names; changed.
        written: For each present name the one in the user's file, which notes and errors use.
    """
    hints = _hints(cls)
    fields = {field.name: field for field in dataclasses.fields(cls)}
    notes: List[str] = []
    for name, given in known.items():
        said = written.get(name, name)
        value, note = _spelt(said, given, hints[name])
        notes += [note] if note else []
        try:
            value = known[name] = convert(said, value, hints[name])
        except ValueError as error:
            if fields[name].metadata.get("has_effect", True):
                raise
            value = known[name] = fields[name].default
            notes.append(f"{error}, and has no effect")
        try:
            _check_range(said, value, fields[name].metadata)
        except ValueError as error:
            nearest = _nearest_allowed(value, fields[name])
            if nearest is None:
                raise
            known[name] = nearest
            notes.append(f"{error}: {nearest} is used")
    defaults = {name: field.default for name, field in fields.items()}
    for low, high in cls.ORDERED:
        lower, higher = (known.get(name, defaults[name]) for name in (low, high))
        if lower > higher >= 0.0:  # below that, giving way would widen the range
            if low in known:
                notes.append(f"parameter {written.get(low, low)} is {lower}; it must be at most "
                             f"{written.get(high, high)}: {higher} is used")
            known[low] = higher
    made = cls(**known)
    return made, notes + made.read_as()


def _nearest_allowed(value: Any, field: Any) -> Any:
    """Return the nearest bound to an invalid `value`, else the default; None where the value must be refused.

    For a rate (Hz) of 0 or less it is the default: at the lowest rate a robot would drive without control for seconds.
    """
    if isinstance(value, str) and (field.metadata.get("else_default") or not field.metadata.get("has_effect", True)):
        return field.default
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not field.metadata.get("clamped", True):
        return None
    if field.metadata.get("unit") in SPEED_UNITS and abs(value) > LARGEST:
        return None  # no replacement is safe, not even a bound
    minimum, maximum, above = (field.metadata.get(key) for key in ("minimum", "maximum", "above"))
    if minimum is not None and value <= 0.0 < minimum and field.metadata.get("unit") == "Hz":
        return field.default
    if maximum is not None and value > maximum:
        return type(value)(maximum)
    if minimum is not None and value < minimum and above is None:
        return type(value)(minimum)
    if abs(value) > field.metadata["largest"] and (above is None or value > above):
        return type(value)(math.copysign(field.metadata["largest"], value))
    return field.default


def number_spelt(text: str) -> Optional[float]:
    """Return the number in a text, without a comment that YAML did not recognize; None where it is no number."""
    try:
        return float(_before_comment(text))
    except ValueError:
        return None


def _before_comment(text: str) -> str:
    return text.partition("#")[0].strip()


def _spelt(name: str, value: Any, hint: Any) -> Tuple[Any, str]:
    """Return a value of another type converted to the number or bool that is expected, and a note; else itself and "".

    YAML 1.1 reads 1e-3 as a string, since it lacks a point; roslaunch's `type="str"` makes strings of all values; and
    after a full-width space, as of Chinese and Japanese keyboards, # begins no comment and belongs to the value. Where
    an integer is expected, a fraction is rounded, halves away from 0, as roscpp does.
    """
    if hint in (bool, Optional[bool]) and not isinstance(value, bool):
        for meant, spellings in SWITCHES.items():
            if _before_comment(str(value)).lower() in spellings:
                return meant, f"parameter {name} is {value!r}: {str(meant).lower()} is used"
    if hint in (int, Optional[int]) and isinstance(value, float) and math.isfinite(value) and not value.is_integer():
        whole = int(math.copysign(math.floor(abs(value) + 0.5), value))
        return whole, f"parameter {name} is {value!r}; it must be a whole number: {whole} is used"
    if not isinstance(value, str) or hint not in (float, int, Optional[float], Optional[int]):
        return value, ""
    number = number_spelt(value)
    if number is None:
        return value, ""
    return number, f"parameter {name} is the text {value!r}: the number {number:g} is used"


def convert(name: str, value: Any, hint: Any) -> Any:
    """Return `value` as the annotated type, or raise a ValueError that names the parameter.

    An int is converted to float, and a float without fraction to int; a bool is never a number.
    """
    origin = getattr(hint, "__origin__", None)
    if origin is typing.Union:
        options = [option for option in hint.__args__ if option is not type(None)]
        return None if value is None else convert(name, value, options[0])
    if origin is tuple:
        return _convert_tuple(name, value, hint.__args__)
    if hint is bool and isinstance(value, bool):
        return value
    if hint in (float, int) and isinstance(value, int) and abs(value) > FAR_BEYOND:
        value = FAR_BEYOND if value > 0 else -FAR_BEYOND
    if hint is float and isinstance(value, (int, float)) and not isinstance(value, bool):
        if math.isnan(value):
            raise ValueError(f"parameter {name} is not a number (NaN)")
        return float(value)
    if hint is int and isinstance(value, (int, float)) and not isinstance(value, bool) and float(value).is_integer():
        return int(value)
    if hint in (bool, float, int, str) and not (hint is str and isinstance(value, str)):
        raise ValueError(f"parameter {name} is {value!r}; it must be of type {hint.__name__}")
    return value


def _convert_tuple(name: str, value: Any, hints: Tuple[Any, ...]) -> Tuple[Any, ...]:
    if isinstance(value, str) or not isinstance(value, (list, tuple)):
        raise ValueError(f"parameter {name} is {value!r}; it must be a list")
    if len(hints) == 2 and hints[1] is Ellipsis:
        hints = (hints[0],) * len(value)
    if len(hints) != len(value):
        raise ValueError(f"parameter {name} has {len(value)} entries; it must have {len(hints)}")
    return tuple(convert(f"{name}[{i}]", entry, hint) for i, (entry, hint) in enumerate(zip(value, hints)))


def _check_range(name: str, value: Any, metadata: Mapping[str, Any]) -> None:
    choices = metadata.get("choices")
    if choices is not None and value not in choices:
        raise ValueError(f"parameter {name} is {value!r}; it must be one of {', '.join(map(repr, choices))}")
    minimum, maximum, above = (metadata.get(key) for key in ("minimum", "maximum", "above"))
    if value is None:
        return
    for entry in value if isinstance(value, tuple) else (value,):
        if minimum is not None and entry < minimum:
            raise ValueError(f"parameter {name} is {value}; it must be at least {minimum}{_unit(metadata)}")
        if maximum is not None and entry > maximum:
            raise ValueError(f"parameter {name} is {value}; it must be at most {maximum}{_unit(metadata)}")
        if above is not None and entry <= above:
            raise ValueError(f"parameter {name} is {value}; it must be above {above}{_unit(metadata)}")
        if isinstance(entry, (int, float)) and abs(entry) > metadata["largest"]:
            largest = f"{metadata['largest']:g}{_unit(metadata)}"
            raise ValueError(f"parameter {name} is {value}; it must be within {largest} of 0")


def _unit(metadata: Mapping[str, Any]) -> str:
    return f" {metadata['unit']}" if metadata.get("unit") else ""
