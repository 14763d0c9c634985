"""Golden of the phone read-out with tiny random weights, and of a path through a text."""

from pathlib import Path

import torch

from training.goldens import write_golden
from training.speech.letters import UNITS, best_path, emissions, states_of, table_of_rules
from training.speech.phones import PhoneConfig, PhoneReadout
from training.speech.train_phones import log_likelihood

TEXT = "Der Größe b, thought 7 – aal"


@torch.no_grad()
def write(out: Path, shared: Path) -> Path:
    """`weights.*`, `input` [T, C] features, `output` [4 T, K] log-posteriors, `said` [4 T], the unit of
    `text` in each row, −1 in a pause.

    `shared` is not used.
    """
    torch.manual_seed(12)
    config = PhoneConfig(channels=16, hidden=8)
    model = PhoneReadout(config).eval()
    for weight in model.parameters():
        torch.nn.init.normal_(weight, std=0.5)
    torch.nn.init.uniform_(model.log_prior, -4.0, -2.0)
    table = torch.from_numpy(table_of_rules()).float()
    tensors = {"weights.table": table, "input": torch.randn(25, config.channels)}
    tensors["output"] = model(tensors["input"][None])[0].contiguous()
    states = states_of(TEXT.split())
    emission = emissions(log_likelihood(model, tensors["input"]), table.double().numpy(), states)
    path = best_path(emission, states.skip)
    # All states of a unit score alike, so which of them the path skips is arbitrary: compare units instead.
    tensors["said"] = torch.from_numpy(states.unit[path]).float()
    written = config.to_json() | {"units": list(UNITS)}
    return write_golden(out / "phones_debug.safetensors", tensors, "phones", model, written, text=TEXT)
