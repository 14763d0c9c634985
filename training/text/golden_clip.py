"""Golden of CLIP's text tower: a small Hugging Face model with random numbers, and a tower on top."""

import json
from pathlib import Path

import torch
from safetensors.torch import save_file
from transformers import CLIPConfig, CLIPTextModelWithProjection, CLIPTokenizer

from training.goldens import write_golden
from training.text.clip import OnClip
from training.text.golden import random_space
from training.text.sentences import clauses
from training.text.stored import arrays, config_of

TEXTS = (
    "a happy person", "a person looks Surprised", "she isn't happy, is she?", "smile", "", "  two   spaces ",
    "Wörter für Lächeln", "你好", "route 66", "closes the eyes " * 5, "I'll wink; they're crying!?", "xyzzy",
)  # fmt: skip
LONGEST = 24
MERGES = (
    "a p", "h a", "ha p", "hap p", "happ y</w>", "s m", "i l", "sm il", "smil e</w>", "e y", "ey e",
    "eye s</w>", "' s</w>", "t h", "th e</w>", "a</w> b", "p e", "r s", "pe rs", "o n</w>", "pers on</w>",
    "i n", "in g</w>", "s h", "sh e</w>", "Ã ¶", "l l</w>", "' ll</w>",
)  # fmt: skip


def vocabulary() -> dict[str, int]:
    """256 bytes, the same bytes at a word's end, their merges, start and end; numbered as in CLIP."""
    visible = [*range(33, 127), *range(161, 173), *range(174, 256)]
    letters = [chr(b) for b in visible] + [chr(256 + n) for n in range(256 - len(visible))]
    joined = [pair.replace(" ", "") for pair in MERGES]
    symbols = [*letters, *(x + "</w>" for x in letters), *joined, "<|startoftext|>", "<|endoftext|>"]
    return {symbol: number for number, symbol in enumerate(symbols)}


def write_folder(folder: Path, width: int = 16) -> tuple[CLIPTokenizer, CLIPTextModelWithProjection]:
    """Writes config.json, vocab.json, merges.txt and model.safetensors; returns their tokenizer and model."""
    folder.mkdir(parents=True, exist_ok=True)
    torch.manual_seed(3)
    numbers = vocabulary()
    text = {"vocab_size": len(numbers), "hidden_size": width, "intermediate_size": 3 * width,
            "num_hidden_layers": 2, "num_attention_heads": 2, "max_position_embeddings": LONGEST,
            "hidden_act": "quick_gelu", "projection_dim": width, "eos_token_id": len(numbers) - 1,
            "bos_token_id": len(numbers) - 2, "initializer_factor": 8.0}  # fmt: skip
    config = CLIPConfig(text_config=text, projection_dim=width)
    model = CLIPTextModelWithProjection(config.text_config).eval()
    for bias in (p for name, p in model.named_parameters() if name.endswith("bias")):
        torch.nn.init.normal_(bias, std=0.1)
    (folder / "vocab.json").write_text(json.dumps(numbers))
    (folder / "merges.txt").write_text("#version: 0.2\n" + "\n".join(MERGES) + "\n")
    (folder / "config.json").write_text(json.dumps({"model_type": "clip", "text_config": text}))
    save_file({k: v.contiguous() for k, v in model.state_dict().items()}, folder / "model.safetensors")
    files = (str(folder / name) for name in ("vocab.json", "merges.txt"))
    return CLIPTokenizer(*files, model_max_length=LONGEST), model


def write(out: Path, shared: Path) -> Path:
    """`weights.*` of CLIP and `model.*` of a tower on top; for each text of the metadata, `places.N` [D] of
    length 1 and `logits.N` [clauses, 3, 16].

    The metadata also has the tokens of each text. `shared` is not used.
    """
    folder = out / "clip_text_folder"
    tokens, model = write_folder(folder)
    tensors = {f"weights.{k}": v.contiguous() for k, v in model.state_dict().items() if v.is_floating_point()}
    words, hearing, numbers = random_space(), OnClip(folder), []
    tower = hearing.tower(7, [])
    tensors |= {f"model.{key}": value for key, value in arrays(tower, words).items()}
    with torch.no_grad():
        for n, text in enumerate(TEXTS):
            inputs = tokens([text], truncation=True, return_tensors="pt")
            numbers.append(inputs["input_ids"][0].tolist())
            tensors[f"places.{n}"] = torch.nn.functional.normalize(model(**inputs).text_embeds[0], dim=-1)
            tensors[f"logits.{n}"] = tower(hearing.hear(clauses(text)))
    metadata = {"texts": json.dumps(TEXTS), "tokens": json.dumps(numbers)}
    for key, file in (("config", "config.json"), ("vocab", "vocab.json"), ("merges", "merges.txt")):
        metadata[key] = (folder / file).read_text()
    metadata["model_config"] = json.dumps(config_of(tower, words, Path("clip")))
    for file in folder.iterdir():
        file.unlink()
    folder.rmdir()
    config = json.loads(metadata.pop("config"))
    return write_golden(out / "clip_text_debug.safetensors", tensors, "clip_text", None, config, **metadata)
