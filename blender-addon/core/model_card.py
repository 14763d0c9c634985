"""The models in a folder of model files, and the titles of their cards."""

from dataclasses import dataclass
from pathlib import Path

_WEIGHTS, _CARD = ("model.safetensors", "model.planes.gz"), "README.md"


@dataclass(frozen=True)
class ModelCard:
    """One model of a folder: its `name`, the `title` of its card and the `path` of the card.

    If the model came without a card, `path` is None and `title` is the name.
    """

    name: str
    title: str
    path: Path | None


def cards(folder: Path) -> list[ModelCard]:
    """The models of `folder`, one in each subfolder; none if it cannot be read."""
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
