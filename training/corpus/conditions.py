"""The emotions and the action units of fine control, which corpora and systems share."""

EMOTIONS = [
    "neutral",
    "happy",
    "pleased",
    "calm",
    "surprised",
    "sad",
    "upset",
    "ashamed",
    "afraid",
    "angry",
    "disgusted",
    "contempt",
    "suspicious",
    "ill",
    "drunk",
]

UNITS = ["1", "2", "4", "5", "6", "7", "9", "10", "12", "14", "15", "17", "20", "26", "28", "45"]
"""The action units that fine control can set (Cafe-Talk §4.2.1, appendix C.2)."""
SIDES = 2
