"""Whether takes obey the coarse condition: Acc and Div (tables 2, 8 and 9 of Cafe-Talk)."""

from collections.abc import Callable

from torch import Tensor

from training.corpus.conditions import EMOTIONS
from training.systems.cafe_talk import judge as judging
from training.systems.cafe_talk.fine_control.trial import Actor, Take, TakeControl

INTENSITIES = (0.0, 0.25, 0.5, 0.75, 1.0, 1.25, 1.5)
NEUTRAL = EMOTIONS.index("neutral")
Scores = dict[str, float]


def performed(actor: Actor, takes: list[Take], **controls) -> Callable[[int, int], Tensor]:
    """A function that generates a take from the number of a clip and the number of an emotion."""

    def make(clip: int, emotion: int) -> Tensor:
        return actor.perform(takes[clip], TakeControl(emotion=EMOTIONS[emotion], **controls))

    return make


def recorded(takes: list[Take], intensity: float) -> Callable[[int, int], Tensor]:
    """A function that adds an emotion to a recording. Its scores are the best that the judge can give."""
    return lambda clip, emotion: judging.under_emotion(takes[clip].truth, emotion, intensity)


def accuracy(judge: judging.Judge, actor: Actor, takes: list[Take], intensity: float = 1.0) -> Scores:
    """Acc and Div at one intensity."""
    return judging.judged(judge, performed(actor, takes, intensity=intensity), len(takes)).scores()


def by_label(judge: judging.Judge, actor: Actor, takes: list[Take]) -> dict[str, Scores]:
    """Table 8: scores with the label present, masked, and at odds with the voice.

    The recorded voices are neutral, so every other label contradicts the voice. With the label masked, a take
    is the same for every emotion, so 1 in 15 is right.
    """
    count = len(takes)
    verdicts = judging.judged(judge, performed(actor, takes, intensity=1.0), count)
    masked = [actor.perform(take, TakeControl(labelled=False)) for take in takes]
    untold = judging.judged(judge, lambda clip, _: masked[clip], count)
    odds = verdicts.true_emotions != NEUTRAL
    return {
        "recordings under the emotion": judging.judged(judge, recorded(takes, 1.0), count).scores(),
        "label told": verdicts.scores(),
        "label masked": untold.scores(),
        "label against the voice, label as truth": verdicts.scores(odds),
        "label against the voice, voice as truth": verdicts.scores(odds, NEUTRAL),
    }


def by_intensity(judge: judging.Judge, actor: Actor, takes: list[Take]) -> dict[str, Scores]:
    """Table 9: Acc and Div from no intensity to 1.5, and the strength that the judge reads.

    `change` is the mean absolute change of a weight against a take without emotion.
    """
    plain = [actor.perform(take) for take in takes]
    rows = {}
    for intensity in INTENSITIES:
        perform, sizes = performed(actor, takes, intensity=intensity), []

        def measure_change(clip: int, emotion: int, perform=perform, sizes=sizes) -> Tensor:
            weights = perform(clip, emotion)
            sizes.append(float((weights - plain[clip]).abs().mean()))
            return weights

        scores = judging.judged(judge, measure_change, len(takes)).scores()
        rows[f"intensity {intensity}"] = scores | {"change": sum(sizes) / len(sizes)}
    return rows
