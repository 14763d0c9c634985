"""Words for the fifteen emotions of the coarse condition in training (Cafe-Talk §3.1.1)."""

SYNONYMS = {
    "neutral": ["neutral", "indifferent", "expressionless", "impassive"],
    "happy": ["happy", "joyful", "cheerful", "delighted", "glad", "merry"],
    "pleased": ["pleased", "content", "satisfied", "amused", "gratified"],
    "calm": ["calm", "serene", "relaxed", "peaceful", "tranquil"],
    "surprised": ["surprised", "amazed", "astonished", "startled", "astounded"],
    "sad": ["sad", "sorrowful", "unhappy", "miserable", "melancholy", "gloomy"],
    "upset": ["upset", "distressed", "hurt", "worried", "troubled"],
    "ashamed": ["ashamed", "embarrassed", "guilty", "humiliated"],
    "afraid": ["afraid", "fearful", "scared", "frightened", "terrified"],
    "angry": ["angry", "furious", "enraged", "irate", "mad"],
    "disgusted": ["disgusted", "repelled", "nauseated", "revolted"],
    "contempt": ["contempt", "scornful", "contemptuous", "disdainful"],
    "suspicious": ["suspicious", "distrustful", "doubtful", "skeptical", "wary"],
    "ill": ["ill", "sick", "unwell", "ailing"],
    "drunk": ["drunk", "intoxicated", "tipsy", "inebriated"],
}
"""Words for each emotion, its own name first. "shocked" and "relieved" are left out as unseen test words."""
