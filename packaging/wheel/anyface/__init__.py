"""Makes any face mesh talk: speech and a mesh in, numpy arrays out.

import anyface

clip = anyface.animate("head.obj", "voice.wav", emotion="happy:0.7")
for positions in clip:      # [V, 3] of each frame, in the mesh's own units, axes and order
    ...
"""

# SPDX-License-Identifier: MIT OR Apache-2.0

from importlib.metadata import version

from .clip import Clip, Weights
from .core.emotion import EMOTIONS
from .core.errors import AnyfaceError, Cancelled
from .core.heard_emotion import HeardEmotion
from .core.microphone import Microphone
from .core.microphone import devices as microphones
from .core.native import Engine
from .core.systems import Control, Field, System
from .core.systems import known as systems
from .core.take import Found, Rig
from .core.weight_stream import Frame
from .stream import Stream
from .talking import animate, find_landmarks, learn_performer, make_rig

__version__ = version("anyface")

__all__ = [
    "EMOTIONS",
    "AnyfaceError",
    "Cancelled",
    "Clip",
    "Control",
    "Engine",
    "Field",
    "Found",
    "Frame",
    "HeardEmotion",
    "Microphone",
    "Rig",
    "Stream",
    "System",
    "Weights",
    "animate",
    "find_landmarks",
    "learn_performer",
    "make_rig",
    "microphones",
    "systems",
]
