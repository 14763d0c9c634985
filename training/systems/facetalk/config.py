"""Sizes of the head, saved as config.json."""

from __future__ import annotations

from dataclasses import dataclass, field

from training.nn.config import Config

PAIRS = [(0, 16), (3, 13), (5, 11), (19, 24), (36, 45), (39, 42), (31, 35), (48, 54)]
MIDDLE = [8, 27, 30, 51, 57]


@dataclass
class HeadConfig(Config):
    """Everything that inference has to know.

    pairs: mirrored anchors, the subject's right one first; middle: anchors on the midline. Both are numbers
    of the 68 landmarks. Inside the model, lengths are metres divided by `scale_m`; `sigma` is in this unit
    and `background` in its square. `bounds_m` is a box that contains any head, in metres. directions: each
    slider's name and how far it moves the face in millimetres.
    """

    system: str = "facetalk"
    model: str = "head"
    name: str = "compact"
    scale_m: float = 0.25
    pairs: list[tuple[int, int]] = field(default_factory=lambda: list(PAIRS))
    middle: list[int] = field(default_factory=lambda: list(MIDDLE))
    global_code: int = 32
    local_code: int = 16
    width: int = 64
    layers: int = 4
    sigma: float = 0.1
    background: float = 0.2
    least_weight: float = 1e-2
    template_width: int = 128
    template_layers: int = 5
    octaves: int = 5
    expression_code: int = 64
    pressed: int = 16
    expression_width: int = 192
    expression_layers: int = 5
    expression_octaves: int = 7
    channels: list[str] = field(default_factory=list)
    open_jaw: float = 0.3
    bounds_m: list[list[float]] = field(default_factory=lambda: [[-0.2] * 3, [0.2] * 3])
    directions: list[dict] = field(default_factory=list)

    @property
    def anchors(self) -> int:
        """Number of anchors."""
        return 2 * len(self.pairs) + len(self.middle)

    @property
    def identity_code(self) -> int:
        """Length of z_id: the global code, then a local code for each anchor and for the background."""
        return self.global_code + (self.anchors + 1) * self.local_code

    @classmethod
    def from_json(cls, data: dict) -> HeadConfig:
        """Reads what `to_json` wrote.

        It also reads the configuration of a folder that holds models to move the head, and ignores these.
        """
        data = {key: value for key, value in data.items() if not key.endswith("motion")}
        return super().from_json(data | {"pairs": [tuple(pair) for pair in data["pairs"]]})


def debug_config() -> HeadConfig:
    """Sizes small enough for a golden."""
    return HeadConfig(
        name="debug",
        pairs=PAIRS[4:6],
        middle=MIDDLE[:2],
        global_code=6,
        local_code=3,
        width=8,
        layers=4,
        template_width=10,
        template_layers=3,
        octaves=2,
        expression_code=5,
        pressed=3,
        expression_width=12,
        expression_layers=4,
        expression_octaves=3,
        channels=["jawOpen", "mouthFunnel"],
    )


def paper_config() -> HeadConfig:
    """The sizes of NPHM's networks.

    NPHM's 39 anchors are vertices of FLAME, which we may not redistribute. Here they are 39 of the landmarks:
    16 pairs and 7 on the midline.
    """
    pairs = [(i, 16 - i) for i in range(0, 8, 2)]
    pairs += [(17 + i, 26 - i) for i in (0, 2, 4)]
    pairs += [(36, 45), (37, 44), (39, 42), (41, 46), (31, 35), (32, 34), (48, 54), (50, 52), (59, 55)]
    return HeadConfig(
        name="paper",
        pairs=pairs,
        middle=[8, 27, 28, 30, 33, 51, 57],
        global_code=64,
        local_code=32,
        width=200,
        layers=4,
        template_width=256,
        expression_code=200,
        pressed=32,
        expression_width=512,
        expression_layers=6,
    )


CONFIGS = {"compact": HeadConfig, "debug": debug_config, "paper": paper_config}
