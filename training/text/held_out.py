"""Descriptions for `training.text.train` to measure on. No training pair has their expression words."""

TABLE_13 = {
    "A person is smiling": "12",
    "A person is crying": "4 15",
    "A person is blinking": "45",
    "A yawning person": "26",
    "A person closes his eyes": "45",
    "A not happy person": "4 15",
}
"""Sentences of Cafe-Talk's table 13 and their units. They are not held out: the training pairs contain their
words.
"""

HELD_OUT = {
    "12": "grin, a person is grinning, a man grins",
    "6 12": "a jolly person, elated, gleeful, a person looks radiant, mirthful, gay, exultant, rejoicing",
    "6 12 26": "chuckle, she giggles, a tittering woman, he guffaws",
    "4 15": (
        "weep, a weeping man, sobbing, scowl, a scowling person, not jolly, she is not elated, blubbering"
    ),
    "1 4 15": "mournful, despondent, glum, a dejected person, woeful, gloomy, a person seems downhearted",
    "1 2 5 26": "astonished, a person looks flabbergasted, stunned, gobsmacked, stupefied, astonishment",
    "4 5 7": "furious, livid, irate, wrathful, a glowering man, incensed",
    "4 7": "peeved, irked, bewildered, puzzled, a person looks vexed",
    "1 2 4 5 7 20 26": "panic, horrified, dread, a petrified woman, panicky",
    "9 10 15": "loathing, nauseated, revulsion, detestation, abhorrence",
    "12L 14L": "disdainful, scorn, disdain",
    "2L 4 7": "dubious, mistrustful, leery, incredulous",
    "1 4 15:0.5": "apprehensive, perturbed, agitated, fretful",
    "1:0.5 15:0.5 28:0.6": "abashed, mortified, sorry",
    "45:0.5": "drowsy, somnolent, slumberous",
    "45": "shuts his eyes, doze, slumbering, eyes are shut",
    "26": "mouth agape, gaping",
    "1 2": "lifts the eyebrows, uplifted brows",
    "4 6 7 10": "wince, flinch, a wincing person",
    "15 17": "sulk, a sulky boy, moue",
    "9": "crinkles her nose",
    "4:1 7:0.5 15": "queasy, ailment",
    "12:0.3 45:0.3": "placid, unruffled, composed",
    "": (
        "purple trousers, a wooden chair, rotes Fahrrad, voiture verte, the bridge over the valley, "
        "quarterly report, tomorrow at noon, kissa istuu, hundred paper boxes, a small village, the "
        "engine starts, vector graphics"
    ),
}
"""Held-out texts by their units. They were written before anything was measured on them."""
