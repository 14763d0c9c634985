"""Deterministic DDIM sampling (Song et al. 2021, eq. 12 with η = 0) of an x₀ predictor."""

from collections.abc import Callable

from torch import Tensor

from training.diffusion.schedule import inference_timesteps

Predictor = Callable[[Tensor, int], Tensor]


def ddim_sample(predict_x0: Predictor, start: Tensor, alphas: Tensor, steps: int, spacing: str) -> Tensor:
    """Runs the reverse process from `start` (any shape) and returns x₀ of the same shape.

    `predict_x0(x, t)` predicts the clean signal from `x` at timestep `t`. `alphas` [train_steps]
    is ᾱ. Before timestep 0, ᾱ = 1 (`set_alpha_to_one`). The previous timestep is
    t − train_steps // steps for both spacings, as in diffusers.
    """
    train_steps = alphas.shape[0]
    x = start
    for t in inference_timesteps(train_steps, steps, spacing):
        previous = t - train_steps // steps
        alpha = alphas[t].to(x.dtype)
        alpha_previous = alphas[previous].to(x.dtype) if previous >= 0 else alpha.new_ones(())
        clean = predict_x0(x, t)
        noise = (x - alpha.sqrt() * clean) / (1.0 - alpha).sqrt()
        x = alpha_previous.sqrt() * clean + (1.0 - alpha_previous).sqrt() * noise
    return x
