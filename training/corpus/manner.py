"""How an emotion changes articulation itself, and how fast it comes and goes.

Sensors on speakers' lips gave these ratios to neutral speech, for the range of the lip aperture and for lip
speed: intense anger 1.26 and 1.48, intense joy 1.20 and 1.32, moderate joy 1.12 and 1.25, moderate sadness
0.83 and 0.81. For the other emotions the direction of the change follows Lee, Yildirim, Kazemzadeh &
Narayanan 2005 ("An articulatory study of emotional speech production"), Magno Caldognetto et al. 2004
(labial targets under emotion) and Chin & Pisoni 1997 (slurred speech under alcohol). Their numbers are our
own choice. Spontaneous expressions take 0.3 to 0.6 s to appear and longer to fade (Ekman 2003, "Darwin,
deception, and facial expression").
"""

from dataclasses import asdict, dataclass

from training.corpus.conditions import EMOTIONS

OFFSET_OVER_ONSET = 1.7


@dataclass(frozen=True)
class Manner:
    """Factors on neutral speech motion at intensity 1.

    `opening` scales the vertical motion of jaw and lips, `rounding` their width and protrusion. `slur` is
    the share of smoothed motion; a negative one makes speech crisper. After `onset_s` seconds nine tenths
    of a change are complete.
    """

    opening: float = 1.0
    rounding: float = 1.0
    slur: float = 0.0
    onset_s: float = 0.4


MANNERS = {
    "neutral": Manner(),
    "happy": Manner(opening=1.2, rounding=0.8, slur=-0.1),
    "pleased": Manner(opening=1.12, rounding=0.9, slur=-0.1),
    "calm": Manner(opening=0.92, slur=0.15, onset_s=0.6),
    "surprised": Manner(opening=1.2, slur=-0.1, onset_s=0.3),
    "sad": Manner(opening=0.83, rounding=0.95, slur=0.05, onset_s=0.6),
    "upset": Manner(opening=0.9, rounding=0.95, slur=0.05, onset_s=0.45),
    "ashamed": Manner(opening=0.75, rounding=0.95, slur=0.2, onset_s=0.55),
    "afraid": Manner(opening=0.95, rounding=0.85, slur=-0.15, onset_s=0.3),
    "angry": Manner(opening=1.26, rounding=1.05, slur=-0.2, onset_s=0.35),
    "disgusted": Manner(opening=1.0, rounding=0.9, onset_s=0.35),
    "contempt": Manner(opening=0.9, rounding=0.9),
    "suspicious": Manner(opening=0.9, rounding=0.95),
    "ill": Manner(opening=0.75, rounding=0.9, slur=0.35, onset_s=0.6),
    "drunk": Manner(opening=0.85, rounding=0.9, slur=0.65, onset_s=0.6),
}


def manners_config() -> dict:
    """The content of config.json in the table of expressions."""
    manners = {emotion: asdict(MANNERS[emotion]) for emotion in EMOTIONS}
    return {"name": "expressions", "emotions": manners, "offset_over_onset": OFFSET_OVER_ONSET}
