"""Golden of emotion classifiers for voices: small Hugging Face models with random weights.

The third model has the regression head that is published for arousal, dominance and valence. Its encoder is
wav2vec2, like that of the first.
"""

import json
from pathlib import Path

import torch
import torch.nn as nn
from torch import Tensor
from transformers import (
    HubertConfig,
    HubertForSequenceClassification,
    Wav2Vec2Config,
    Wav2Vec2ForSequenceClassification,
    Wav2Vec2Model,
)

from training.goldens import write_golden

SIZES = {"hidden_size": 16, "num_hidden_layers": 2, "num_attention_heads": 2, "intermediate_size": 24,
         "conv_dim": [8] * 7, "num_conv_pos_embeddings": 8, "num_conv_pos_embedding_groups": 2,
         "classifier_proj_size": 12, "attn_implementation": "eager"}  # fmt: skip
SECONDS = 2


class Regression(nn.Module):
    """Mean of the hidden states, then a linear layer with tanh, then a linear layer."""

    def __init__(self, config: Wav2Vec2Config):
        super().__init__()
        self.wav2vec2 = Wav2Vec2Model(config)
        self.classifier = nn.ModuleDict(
            {
                "dense": nn.Linear(config.hidden_size, config.hidden_size),
                "out_proj": nn.Linear(config.hidden_size, 3),
            }
        )

    def forward(self, samples: Tensor) -> Tensor:
        """[1, S] to [1, 3]."""
        pooled = self.wav2vec2(samples).last_hidden_state.mean(dim=1)
        return self.classifier["out_proj"](torch.tanh(self.classifier["dense"](pooled)))


def labelled(*labels: str) -> dict:
    """The labels in the form in which `config.json` lists them."""
    return {"id2label": dict(enumerate(labels)), "label2id": {label: n for n, label in enumerate(labels)}}


def write(out: Path, shared: Path) -> Path:
    """`input` [S]; `NAME.weights.*` and `NAME.logits` of each model; its config is in the metadata.

    `shared` is not used.
    """
    torch.manual_seed(11)
    mixed = Wav2Vec2Config(**SIZES, **labelled("neutral", "happy", "angry", "sad"), do_stable_layer_norm=True,
                           feat_extract_norm="layer", use_weighted_layer_sum=True)  # fmt: skip
    # Such models were trained with transformers 4, in which the last hidden state is the normalised output.
    mixed.tie_last_hidden_states = True
    plain = HubertConfig(**SIZES, **labelled("angry", "happiness", "neutral", "sad", "other"))
    dimensions = Wav2Vec2Config(**SIZES, **labelled("arousal", "dominance", "valence"))
    models = {
        "wav2vec2": (mixed, Wav2Vec2ForSequenceClassification(mixed)),
        "hubert": (plain, HubertForSequenceClassification(plain)),
        "regression": (dimensions, Regression(dimensions)),
    }
    samples = torch.randn(SECONDS * 16000)
    normal = (samples - samples.mean()) / (samples.var(correction=0) + 1e-7).sqrt()
    tensors, configs = {"input": samples}, {}
    for name, (config, model) in models.items():
        for parameter in model.parameters():
            nn.init.normal_(parameter, std=0.3)
        with torch.no_grad():
            logits = model.eval()(normal[None])
        tensors[f"{name}.logits"] = (logits if isinstance(logits, Tensor) else logits.logits)[0]
        state = {k: v for k, v in model.state_dict().items() if "masked_spec" not in k}
        tensors |= {f"{name}.weights.{key}": value.contiguous() for key, value in state.items()}
        configs[f"{name}.config"] = json.dumps(config.to_dict())
    return write_golden(out / "emotion_model_debug.safetensors", tensors, "emotion_model", **configs)
