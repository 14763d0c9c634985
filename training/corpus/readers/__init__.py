"""Readers of published corpora: each turns a downloaded corpus into a corpus folder."""

from training.corpus.readers.flame import emovoca, mead, ravdess
from training.corpus.readers.openface import openface
from training.corpus.readers.project import facegood_zh, grid_s1
from training.corpus.readers.sequences import biwi, multiface, vocaset
from training.corpus.readers.weights import beat, live_link_face

READERS = {
    "vocaset": vocaset,
    "biwi": biwi,
    "multiface": multiface,
    "mead": mead,
    "ravdess": ravdess,
    "emovoca": emovoca,
    "beat": beat,
    "live_link_face": live_link_face,
    "openface": openface,
    "grid_s1": grid_s1,
    "facegood_zh": facegood_zh,
}
"""Corpus name → its reader.

A reader gets the corpus, the folder to write, and the landmarks of the corpus's topology.
"""
