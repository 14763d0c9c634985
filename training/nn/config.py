"""Sizes of a model as they stand in its config.json."""

from dataclasses import asdict, dataclass, is_dataclass
from typing import Any, TypeVar, get_args, get_type_hints

Sizes = TypeVar("Sizes", bound="Config")


class Config:
    """Base of the dataclasses that hold everything inference needs."""

    def to_json(self) -> dict:
        """As written to config.json."""
        return asdict(self)

    @classmethod
    def from_json(cls: type[Sizes], data: dict) -> Sizes:
        """Reads what `to_json` wrote, nested dataclasses included."""
        kinds = get_type_hints(cls)
        return cls(**{name: _read(kinds[name], value) for name, value in data.items()})


def _read(kind: Any, value: Any) -> Any:
    parts = [part for part in (kind, *get_args(kind)) if is_dataclass(part)]
    if not parts or value is None:
        return value
    return [parts[0](**item) for item in value] if isinstance(value, list) else parts[0](**value)


@dataclass
class SpeechInput:
    """Which encoder feeds a model; `transformer_fps` is for `training.speech.hubert.HubertFeatures`."""

    encoder: str = "ear"
    channels: int = 192
    transformer_fps: float | None = None
