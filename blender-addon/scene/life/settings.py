"""The artist's settings for head and eyes."""

from dataclasses import dataclass

# Controls of the library that *Life* turns off together.
CONTROLS = ("head_motion", "gaze", "breath", "variety", "blinks_per_minute")


@dataclass
class LifeSettings:
    """The names of the objects and bones that act as head and eyes.

    `head` is "NONE", "OBJECT", "BONE" or "OWN" (an action that no object plays). `gaze` is "NONE",
    "PARTS" or "BONES". `eyes` and `eye_bones` name the right eye first. If no eyes are named, parts
    with the role gaze turn. If `look_at` names an object, the eyes rest on it.
    """

    use: bool = True
    head: str = "NONE"
    head_object: str = ""
    head_bone: str = ""
    gaze: str = "NONE"
    eyes: tuple[str, str] = ("", "")
    eye_armature: str = ""
    eye_bones: tuple[str, str] = ("", "")
    look_at: str = ""

    @property
    def names(self) -> list[str]:
        """The names of all objects that take part."""
        return [self.head_object, *self.eyes, self.eye_armature, self.look_at]

    def rename(self, now: dict[str, str]) -> None:
        """Updates the names of renamed objects; `now` maps old names to new ones."""
        for name in ("head_object", "eye_armature", "look_at"):
            setattr(self, name, now.get(getattr(self, name), getattr(self, name)))
        self.eyes = tuple(now.get(name, name) for name in self.eyes)

    @property
    def controls_off(self) -> tuple[str, ...]:
        """The controls that are 0, whatever the panel says.

        These are all of *Life* if it is off, otherwise head motion if no head turns.
        """
        return CONTROLS if not self.use else ("head_motion",) if self.head == "NONE" else ()
