"""The tower's training data: texts that we wrote, and the units that show them.

The seven emotions have the units of Ekman & Friesen's tables, as far as the sixteen units include them. We
chose the units of everyday expressions, lay names and the other emotions ourselves. `12L` is on one side
only: the left if a text names no side. `45:0.3` has strength 0.3; without a number the strength is 1. No word
for an expression in `training.text.held_out` occurs here.
"""

EMOTIONS = {
    "6 12": (
        "happy, joyful, cheerful, delighted, glad, merry, happiness, joy, cheerfulness, delight, "
        "gladness, ecstatic, blissful, overjoyed, jubilant, enjoyment, fun, playful, enthusiastic, "
        "thrilled, euphoria, lighthearted, laughing eyes, excited, loving, affectionate, adoring, "
        "welcoming, friendly"
    ),
    "6:0.4 12:0.5": (
        "pleased, content, satisfied, amused, gratified, contentment, satisfaction, amusement, "
        "pleasure, grateful, thankful, proud, pride, relieved, relief, kind, tender, flattered, "
        "hopeful, optimistic"
    ),
    "12:0.3 45:0.3": "calm, serene, relaxed, peaceful, tranquil, serenity, calmness, dreamy",
    "1 2 5 26": (
        "surprised, surprise, amazed, startled, astounded, amazement, shocked, shock, awe, awestruck, "
        "thunderstruck, dumbfounded, gasp, wide-eyed wonder, disbelief, speechless"
    ),
    "1 4 15": (
        "sad, sorrowful, miserable, melancholy, sadness, sorrow, misery, grief, grieving, depressed, "
        "heartbroken, disappointed, disappointment, lonely, homesick, despair, hopeless, pity, "
        "sympathetic, forlorn, dismal, moping, hurt, longing"
    ),
    "4 15": (
        "unhappy, unhappiness, cry, crying, in tears, tearful, frown, frowning, displeased, "
        "discontented, dissatisfied, displeasure, cheerless, joyless, downcast mouth, grumpy, moody, "
        "sullen, bawl, wail, lament"
    ),
    "1 4 15:0.5": (
        "upset, distressed, worried, troubled, anxious, distress, worry, anxiety, concerned, nervous, "
        "uneasy, apologetic, pleading, begging, imploring, guilt"
    ),
    "1:0.5 15:0.5 28:0.6": (
        "ashamed, embarrassed, guilty, humiliated, shame, embarrassment, humiliation, bashful, shy, "
        "remorseful, sheepish, timid, regret"
    ),
    "1 2 4 5 7 20 26": (
        "afraid, fearful, scared, frightened, terrified, fear, fright, terror, scream, alarmed, "
        "spooked, phobia, haunted, threatened"
    ),
    "4 5 7": (
        "angry, enraged, mad, anger, rage, outraged, hostile, hateful, hatred, aggressive, resentful, "
        "indignant, indignation, glare, glaring, threatening, menacing, vengeful, fierce, seething"
    ),
    "4 7": (
        "annoyed, irritated, annoyance, irritation, impatient, frustrated, frustration, confused, "
        "confusion, concentrating, concentration, thinking hard, determined, determination, stern, "
        "strict, serious, focused, perplexed, tense, stubborn, squinting at the sun, knitted brows, "
        "knits the brows, disapproving"
    ),
    "9 10 15": (
        "disgusted, repelled, revolted, disgust, repulsed, gross, disgusting, repugnance, distaste, "
        "smells something bad, stink, aversion, yuck, foul smell"
    ),
    "12L 14L": (
        "contempt, contemptuous, smirk, smirking, smug, arrogant, condescending, haughty, cynical, "
        "sly, cocky, mischievous, crooked smile, half smile, lopsided smile, sardonic, snide, "
        "superior, wry"
    ),
    "2L 4 7": (
        "suspicious, distrustful, doubtful, skeptical, wary, suspicion, distrust, doubt, skepticism, "
        "quizzical, questioning, unconvinced, inquisitive, unbelieving"
    ),
    "4 7:0.5 15": "ill, sick, unwell, ailing, illness, sickness, sickly, feverish, hangover",
    "1:0.4 12:0.3 45:0.4": "drunk, intoxicated, tipsy, inebriated, drunken, stoned",
    "45:0.5": (
        "sleepy, tired, exhausted, weary, bored, boredom, fatigue, sleepiness, heavy eyelids, "
        "drooping lids, half-closed eyes, lids hang, apathetic, languid, lethargic"
    ),
    "1 2": "curious, interested, interest, curiosity, attentive, alert, expectant, intrigued, fascinated",
    "4 6 7 10": (
        "pain, painful, in pain, agony, aching, suffering, grimace, grimacing, ache, tortured, "
        "anguish, torment"
    ),
}
"""Words for emotions and states of mind, by the units that show them."""

EXPRESSIONS = {
    "12": (
        "smile, smiling, corners of the mouth up, mouth corners rise, lip corners pulled up, raises "
        "the corners of the mouth, lips curl upwards, smiley, smile politely, friendly smile, mouth "
        "curves up"
    ),
    "6 12": (
        "genuine smile, smile with the eyes, beaming smile, happy smile, smile from ear to ear, smiling eyes"
    ),
    "6 12 26": (
        "laugh, laughing, laughter, laughs out loud, bursts out laughing, hilarious, hilarity, "
        "open-mouthed smile, hysterical laugh, roaring laugh, happy laugh, joke, funny"
    ),
    "12 14": (
        "sarcastic, sarcasm, ironic, irony, mocking, mockery, ridicule, teasing, sarcastic smile, "
        "mocking smile, taunting"
    ),
    "12 14 26": "sarcastic laugh, ironic laugh, mocking laugh, laughs sarcastically",
    "1 2 45": "surprised blink, blinks in surprise, startled blink, blink with amazement",
    "45": (
        "blink, blinking, closes the eyes, eyes close, closed eyes, closing eyes, eyes are closed, "
        "asleep, sleeping, sleep, lowers the eyelids, eyelids close, eyelids down, eye closure, "
        "flutters the eyelids, eyelids drop, blind, nap, close one's eyes, fast blinks, praying with "
        "closed eyes, faints, unconscious"
    ),
    "45L": "wink, winking, winks, winks an eye, closes one eye, winked",
    "9 10": (
        "sneer, sneering, snarl, snarling, sneers, baring the teeth, shows the teeth, curls the upper lip"
    ),
    "26": (
        "yawn, yawning, opens the mouth, open mouth, mouth opens, mouth open, drops the jaw, jaw "
        "drops, dropped jaw, jaw drop, lowers the jaw, jaw down, open jaw, opens the lips, mouth "
        "falls, singing, shouting, yell, shout"
    ),
    "15 17": (
        "pout, pouting, petulant, pouts like a child, sticks out the lower lip, lower lip out, pouty, "
        "offended"
    ),
    "7": (
        "squint, squinting, narrows the eyes, narrow eyes, narrowed eyes, eyes narrow, tightens the "
        "lids, lid tightener, tight eyelids, short-sighted, eyes become slits, scrutinizing"
    ),
    "5": (
        "stare, staring, wide eyes, widens the eyes, eyes wide, opens the eyes, opens the eyes wide, "
        "raises the upper lids, upper lid raiser, eyes open wide, big round eyes, bulging eyes, eyes "
        "pop, gaze"
    ),
    "6": (
        "raises the cheeks, cheek raiser, cheeks up, cheeks rise, squeezes the cheeks, crow's feet, "
        "cheek raised"
    ),
    "1 2": (
        "raises the eyebrows, raised eyebrows, eyebrows up, eyebrows rise, raised brows, brows up, "
        "raises the brows, eyebrow raise, raise forehead, wrinkles the forehead, brows high, moves "
        "the eyebrows up, forehead wrinkles"
    ),
    "1": (
        "inner brow raiser, raises the inner brows, inner eyebrows up, inner brow raised, inner ends "
        "of the brows"
    ),
    "2": (
        "outer brow raiser, raises the outer brows, outer eyebrows up, outer brow raised, outer ends "
        "of the brows"
    ),
    "2L": "cocked eyebrow, arched eyebrow, arches an eyebrow",
    "4": (
        "brow lowerer, lowers the brows, lowers the eyebrows, brows down, lowered eyebrows, furrows "
        "the brow, furrowed brow, eyebrows together, brows lowered, draws the brows together, "
        "eyebrows down, furrow, lowered brow"
    ),
    "9": (
        "wrinkles the nose, nose wrinkler, wrinkled nose, nose wrinkles, screws up the nose, flares "
        "the nostrils, sniff"
    ),
    "10": "upper lip raiser, raises the upper lip, upper lip up, raised upper lip, upper lip rises",
    "14": (
        "dimpler, dimples, dimple, dimpled cheeks, mouth corners tight, tightens the corners of the mouth"
    ),
    "15": (
        "lip corner depressor, corners of the mouth down, mouth corners down, lowers the corners of "
        "the mouth, mouth turns down, lips turn down, downturned mouth, mouth corners drop"
    ),
    "17": (
        "chin raiser, raises the chin, chin up, pushes the chin up, wrinkles the chin, chin quivers, "
        "trembling chin"
    ),
    "20": (
        "lip stretcher, stretches the lips, stretched lips, stretches the mouth, mouth stretched "
        "wide, lips wide"
    ),
    "28": (
        "lip suck, sucks the lips in, lips in, rolls the lips in, presses the lips, pressed lips, "
        "bites the lips, tight-lipped, lips together, presses lips together, hides the lips, lip bite"
    ),
}
"""Texts for facial movements, by their units: everyday names, names of units and lay descriptions."""

OPPOSITES = {"6 12": "4 15", "6:0.4 12:0.5": "4 15", "1 4 15": "12:0.5", "4 15": "12:0.5",
             "1 4 15:0.5": "12:0.5", "4 5 7": "12:0.3",
             "1 2": "45:0.5", "12:0.3 45:0.3": "4 7", "45:0.5": "5:0.5"}  # fmt: skip
"""Units that "not …" shows, by the units of the denied text. Denying any other text shows no units."""

NOTHING = (
    "neutral, the blue car, blue paint, blue, expressionless, impassive, indifferent, blank, poker, "
    "numb, a car, the white house, a table, seven bicycles, monday morning, the sky, number nine, "
    "music, money, run, walk the dog, a green apple, the weather is fine, computer, river, water, "
    "stone, king, train station, hand, arm, leg, foot, hair, ear, ears, eye, mouth, nose, cheek, "
    "chin, lips, eyebrow, jaw, tongue, neck, head turns, breakfast, salt, business, government, law, "
    "black, white, red, yellow, big city, school, window, door opens, close the door, raise money, "
    "open the window, drop the price, lower price, wide road, stretch of road, tight budget, high "
    "mountain, das ist gut, guten morgen, ein haus, das auto fährt, bonjour monsieur, la maison est "
    "grande, le chat noir, buenos días, la casa grande, el perro corre, buongiorno, una bella casa, "
    "hyvää päivää, talo on suuri, god dag, et hus, привет мир, дом большой, 你好, "
    "今天天气很好, "
    "こんにちは, asdf qwer, lorem ipsum dolor, xyzzy, hmm, the, camera light, "
    "the man reads a book, an old coat"
)
"""Texts that do not describe any movement of a face."""

TEMPLATES = ("a {} person", "a person looks {}", "a person seems {}", "a man acts like {}",
             "a woman acts like {}", "a person is {}", "a person behaves {}", "a person is talking with {}",
             "{}", "she {}", "he is {}", "with a {} face", "looking {}")  # fmt: skip
"""The eight templates of Cafe-Talk's table 12, then plain ones. Their own words carry no meaning."""

MENU = (
    "smile, laugh, smirk, sarcastic laugh, cry, frown, sneer, wink, blink, surprised blink, yawn, "
    "gasp, pout, squint, stare, glare, grimace, happy, sad, angry, afraid, surprised, disgusted, "
    "contempt, suspicious, ashamed, sleepy, raised eyebrows, furrowed brow, closed eyes, open mouth, "
    "wrinkled nose, pressed lips"
)
"""Expressions to suggest for a text that yields no units. The nearest one is suggested."""
