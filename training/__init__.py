"""Training of Anyface: the same model files as `rust-core/src`, in PyTorch."""

from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[1]
WEIGHTS = REPOSITORY / "weights"
DATA = Path("../shared/data")


def shipped(name: str) -> Path:
    """The folder of a model that the library embeds, in the data crate that has it; a new one belongs to none yet."""
    return next(WEIGHTS.glob(f"*/{name}"), WEIGHTS / name)
