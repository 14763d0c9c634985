"""Places words so that synonyms lie together and opposites lie apart.

    python -m training.text.space --wordnet /usr/share/wordnet --out runs/text

The nodes of a graph are words and meanings. Synonyms are tied to a shared meaning. Meanings are tied to each
other by WordNet's relations, and to the words of their definitions; ties between antonyms are negative.
Random vectors walk over the graph (Chen, Sultan, Tian, Chen & Skiena 2019, "Fast and accurate network
embeddings via very sparse random projection"). The walk keeps the signs of the ties, so that antonyms end on
opposite sides (Kunegis et al. 2010). Principal components reduce the vectors to `WIDTH` numbers. Other words
are placed by their letters: n-grams of 3 to 5, whose vectors are fitted to the known words by ridge
regression.
"""

import re
import zlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.sparse import coo_matrix, csr_matrix, diags
from scipy.sparse.linalg import lsqr

from training.flags import run_command
from training.text import wordnet

WIDTH = 64
WORDS = 8000
BUCKETS = 2048
NGRAMS = (3, 4, 5)
RANDOM_WIDTH = 2048
NODES = 40000
STEPS = (0.4, 1.0, 1.0, 1.0, 1.0, 0.8, 0.6, 0.4)
"""Weight of each step of the walk in the sum of normalised vectors."""
TIES = {"&": 0.7, "@": 0.5, "~": 0.2, "+": 0.8, "^": 0.4, "=": 0.3, "*": 0.3, ">": 0.3}
TIES |= {"$": 0.5, "\\": 0.6, "<": 0.6}
ANTONYM = -1.5
EXPLAINED = 0.8
FREQUENT_SHARE = 0.35
STOP = set(
    "a an the of or and in to for with that is are be by as on from at which it its not no one who "
    "having used some any being was were especially usually very something someone somebody other "
    "than into more less their his her your you they them he she has have been can may such when "
    "where while without".split()
)
SEEDS = (
    "smile frown laugh cry grin wink blink squint sneer scowl grimace pout yawn stare glare gasp "
    "scream sob weep emotion feeling expression face facial eye eyebrow brow eyelid lip mouth jaw "
    "cheek nose chin forehead happy sad angry afraid surprised disgusted contempt calm neutral "
    "pleased upset ashamed suspicious ill drunk joy sorrow anger fear surprise disgust shame pride "
    "love hate boredom tired sleepy pain worry doubt confusion excited proud jealous bitter sarcastic "
    "ironic skeptical puzzled shocked relieved amused bored nervous raise lower open close tighten "
    "press part stretch wrinkle smirk chuckle giggle whisper shout speak say tell look"
).split()


@dataclass
class TextSpace:
    """`words` [W] in order, their `vectors` [W, D] of length 1, and `ngrams` [BUCKETS, D]."""

    words: list[str]
    vectors: np.ndarray
    ngrams: np.ndarray


def build(folder: Path, seed: int = 0) -> TextSpace:
    """Builds the space from WordNet's files; takes a minute."""
    synsets = wordnet.read(folder)
    frequency = word_frequency(wordnet.counts(folder))
    names, matrix = graph(synsets, frequency)
    rank = nearness(names, matrix)
    chosen = choose(names, rank, frequency)
    part = np.union1d(chosen, np.argsort(-rank, kind="stable")[:NODES])
    vectors = walked(matrix[part][:, part], seed)
    chosen = np.searchsorted(part, chosen)
    names = [names[i] for i in part]
    places = isotropic(vectors[chosen])
    words = [names[i] for i in chosen]
    order = np.argsort(words)
    words, places = [words[i] for i in order], places[order]
    return TextSpace(words, places, ngram_vectors(words, places))


def word_frequency(counts: dict[tuple[str, str], int]) -> dict[str, int]:
    """How often each word occurs, summed over its parts of speech."""
    total: dict[str, int] = {}
    for (word, _), times in counts.items():
        total[word] = total.get(word, 0) + times
    return total


def graph(synsets: dict[str, wordnet.Synset], frequency: dict[str, int]) -> tuple[list[str], csr_matrix]:
    """Names of the nodes (words, then meanings) and the symmetric matrix of their ties."""
    words = sorted({w for s in synsets.values() for w in s.words})
    names = [*words, *synsets]
    at = {name: i for i, name in enumerate(names)}
    rows, columns, ties = [], [], []

    def tie(a: int, b: int, weight: float) -> None:
        rows.extend((a, b))
        columns.extend((b, a))
        ties.extend((weight, weight))

    for key, synset in synsets.items():
        for word in synset.words:
            tie(at[key], at[word], 1.0)
        for pointer in synset.pointers:
            _relate(tie, at, synsets, key, synset, pointer)
    explained = [(at[k], at[w]) for k, s in synsets.items() for w in explaining(s.gloss, at, s.words)]
    spoken = np.bincount([w for _, w in explained], minlength=len(names))
    for key, word in explained:
        tie(key, word, EXPLAINED / (1.0 + np.log1p(spoken[word])))
    size = len(names)
    matrix = coo_matrix((ties, (rows, columns)), (size, size)).tocsr()
    return names, matrix


def _relate(tie, at, synsets, key, synset, pointer) -> None:
    if pointer.target not in synsets:
        return
    weight = ANTONYM if pointer.relation == "!" else TIES.get(pointer.relation, 0.0)
    if weight == 0.0:
        return
    target = synsets[pointer.target]
    if pointer.word and pointer.target_word:
        tie(at[synset.words[pointer.word - 1]], at[target.words[pointer.target_word - 1]], weight)
    tie(at[key], at[pointer.target], weight)


def explaining(gloss: str, known: dict[str, int], excluded: list[str]) -> set[str]:
    """Known words of a definition, without those of its examples."""
    said = re.sub(r'"[^"]*"', "", gloss).lower()
    forms = {known_form(w, known) for w in re.findall(r"[a-z]+", said) if w not in STOP}
    return {w for w in forms if w and w not in excluded}


def known_form(word: str, known) -> str | None:
    """The word if `known` has it, else a known stem without an English ending, else None."""
    forms = [word]
    for ending, instead in (("ies", "y"), ("es", ""), ("s", ""), ("ing", ""), ("ing", "e"), ("ed", ""),
                            ("ed", "e"), ("ly", ""), ("ily", "y"), ("er", ""), ("est", "")):  # fmt: skip
        if word.endswith(ending) and len(word) - len(ending) >= 3:
            stem = word[: len(word) - len(ending)] + instead
            forms.append(stem)
            if len(stem) > 3 and not instead and stem[-1] == stem[-2]:
                forms.append(stem[:-1])
    return next((form for form in forms if form in known), None)


def walked(matrix: csr_matrix, seed: int) -> np.ndarray:
    """Random vectors after a weighted walk over the signed ties, [N, RANDOM_WIDTH] f32."""
    random = np.random.default_rng(seed)
    degree = np.asarray(abs(matrix).sum(axis=1)).ravel()
    scale = diags(1.0 / np.sqrt(np.maximum(degree, 1e-9)))
    step = (scale @ matrix @ scale).astype(np.float32).tocsr()
    state = random.standard_normal((matrix.shape[0], RANDOM_WIDTH)).astype(np.float32)
    state *= np.maximum(degree, 1.0).astype(np.float32)[:, None] ** -0.25
    total = np.zeros_like(state)
    for weight in STEPS:
        state = step @ state
        size = np.linalg.norm(state, axis=1, keepdims=True)
        total += weight * state / np.maximum(size, 1e-9)
    return total


def choose(names: list[str], rank: np.ndarray, frequency: dict[str, int]) -> np.ndarray:
    """Numbers of the words to keep: frequent words, and words near the seeds."""
    words = np.array([i for i, n in enumerate(names) if n.isalpha() and not n[-1].isdigit()])
    near = rank[words]
    often = np.array([frequency.get(names[i], 0) for i in words])
    frequent = words[np.argsort(-often, kind="stable")][: int(FREQUENT_SHARE * WORDS)]
    by_seed = words[np.argsort(-near * (1.0 + 0.3 * np.log1p(often)), kind="stable")]
    chosen = dict.fromkeys(frequent)
    for word in by_seed:
        if len(chosen) == WORDS:
            break
        chosen.setdefault(word)
    return np.array(list(chosen))


def nearness(names: list[str], matrix: csr_matrix) -> np.ndarray:
    """Personalised PageRank from the seeds over the ties, regardless of their signs, [N]."""
    at = {n: i for i, n in enumerate(names)}
    start = np.zeros(len(names))
    start[[at[s] for s in SEEDS if s in at]] = 1.0
    start /= start.sum()
    ties = abs(matrix)
    flow = (diags(1.0 / np.maximum(np.asarray(ties.sum(axis=1)).ravel(), 1e-9)) @ ties).T.tocsr()
    rank = start
    for _ in range(20):
        rank = 0.3 * start + 0.7 * (flow @ rank)
    return rank


def isotropic(vectors: np.ndarray) -> np.ndarray:
    """Principal components [W, WIDTH] of length 1; a square root evens out their spread."""
    unit = vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-9)
    centred = unit - unit.mean(axis=0)
    u, s, _ = np.linalg.svd(centred, full_matrices=False)
    components = u[:, :WIDTH] * np.sqrt(s[:WIDTH])
    components *= np.sign(components[np.abs(components).argmax(axis=0), np.arange(WIDTH)])
    return (components / np.linalg.norm(components, axis=1, keepdims=True)).astype(np.float32)


def ngram_buckets(word: str) -> list[int]:
    """Buckets of the n-grams of `<word>` (CRC-32 of their UTF-8, modulo `BUCKETS`)."""
    marked = f"<{word}>"
    grams = (marked[i : i + n] for n in NGRAMS for i in range(len(marked) - n + 1))
    return [zlib.crc32(gram.encode()) % BUCKETS for gram in grams]


def ngram_vectors(words: list[str], vectors: np.ndarray) -> np.ndarray:
    """Fits bucket vectors [BUCKETS, WIDTH], so that their mean over a word comes near its own vector."""
    rows, columns, shares = [], [], []
    for row, word in enumerate(words):
        buckets = ngram_buckets(word)
        rows += [row] * len(buckets)
        columns += buckets
        shares += [1.0 / len(buckets)] * len(buckets)
    grams = coo_matrix((shares, (rows, columns)), (len(words), BUCKETS)).tocsr()
    fitted = [lsqr(grams, column, damp=0.5)[0] for column in vectors.T]
    return np.stack(fitted, axis=1).astype(np.float32)


def main(wordnet: Path = wordnet.PLACE, out: Path = Path("runs/text")) -> None:
    space = build(wordnet)
    out.mkdir(parents=True, exist_ok=True)
    arrays = {"vectors": space.vectors.astype(np.float16), "ngrams": space.ngrams.astype(np.float16)}
    np.savez(out / "space.npz", words=np.array(space.words), **arrays)
    print(f"{len(space.words)} words, {sum(a.nbytes for a in arrays.values()) / 1e6:.2f} MB")


if __name__ == "__main__":
    run_command(main)
