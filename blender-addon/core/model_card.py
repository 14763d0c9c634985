"""What a folder of model files holds, and what its cards say of it."""

from dataclasses import dataclass
from pathlib import Path

_WEIGHTS, _CARD = ("model.safetensors", "model.planes.gz"), "README.md"


@dataclass(frozen=True)
class ModelCard:
    """One model of a folder: its `name`, what its card is headed with, and where that lies.

    `path` is None, and `title` the name, where the model came without a card.
    """

    name: str
    title: str
    path: Path | None


def cards(folder: Path) -> list[ModelCard]:
    """The models of `folder`, a folder each; none where it cannot be read."""
    try:
        names = sorted({path.parent.name for name in _WEIGHTS for path in folder.glob(f"*/{name}")})
    except OSError:
        return []
    return [_card(folder / name) for name in names]


def changed_ns(folder: Path) -> int:
    """When a model of `folder` last changed, in nanoseconds since 1970; 0 where there is none."""
    files = (path for name in (*_WEIGHTS, "config.json") for path in folder.glob(f"*/{name}"))
    return max((path.stat().st_mtime_ns for path in files), default=0)


def _card(model: Path) -> ModelCard:
    path = model / _CARD
    try:
        lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return ModelCard(model.name, model.name, None)
    title = next((line.lstrip("# ").strip() for line in lines if line.startswith("#")), "")
    return ModelCard(model.name, title or model.name, path)
