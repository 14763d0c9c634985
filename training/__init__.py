"""Training of Anyface: the same model files as `rust-core/src`, in PyTorch."""

from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[1]
WEIGHTS = REPOSITORY / "weights"
DATA = Path("../shared/data")


def shipped(name: str) -> Path:
    """Returns the folder of an embedded model: in its data crate, or directly in weights/ for a new model."""
    return next(WEIGHTS.glob(f"*/{name}"), WEIGHTS / name)
