"""Training of Anyface: the same model files as `rust-core/src`, in PyTorch."""

from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[1]
SHIPPED = REPOSITORY / "rust-core/models"
DATA = Path("../shared/data")


def shipped(name: str) -> Path:
    """The folder of a model that the library embeds."""
    return SHIPPED / name
