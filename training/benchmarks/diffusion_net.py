"""DiffusionNet forward: width 128, 4 blocks, K = 128, 26,719 vertices, random numbers.

    python -m training.benchmarks.diffusion_net

The twin of `cargo bench -p anyface --bench diffusion_net`; both run on two threads.
"""

import time

import torch

from training.nn.diffusion_net import DiffusionNet, SurfaceOperators

VERTICES, EIGENPAIRS, WIDTH, BLOCKS, THREADS, RUNS = 26_719, 128, 128, 4, 2, 10


def random_operators() -> SurfaceOperators:
    """Operators of the right shapes, with seven neighbours per vertex."""
    rows = torch.arange(VERTICES).repeat_interleave(7)
    columns = (rows + torch.arange(7).repeat(VERTICES) * 53) % VERTICES
    values = torch.rand(rows.shape[0]) * 2 - 1
    size = (VERTICES, VERTICES)
    gradient = torch.sparse_coo_tensor(torch.stack([rows, columns]), values, size)
    gradient = gradient.coalesce().to_sparse_csr()
    return SurfaceOperators(
        mass=torch.full((VERTICES,), 1.0 / VERTICES),
        evals=torch.arange(EIGENPAIRS).float(),
        evecs=torch.rand(VERTICES, EIGENPAIRS) * 2 - 1,
        grad_x=gradient,
        grad_y=gradient,
    )


@torch.inference_mode()
def main() -> None:
    """Prints the least and median seconds per call, and the least seconds per frame."""
    torch.manual_seed(0)
    torch.set_num_threads(THREADS)
    ops = random_operators()
    network = DiffusionNet(3, 3, WIDTH, BLOCKS).eval()
    for batch in (1, 4):
        x = torch.rand(batch, VERTICES, 3)
        network(x, ops)
        seconds = []
        for _ in range(RUNS):
            start = time.perf_counter()
            network(x, ops)
            seconds.append(time.perf_counter() - start)
        seconds.sort()
        least, median = seconds[0], seconds[RUNS // 2]
        print(
            f"torch {torch.__version__}, {THREADS} threads, {batch} frames: "
            f"least {least:.3f} s, median {median:.3f} s, {least / batch:.3f} s a frame"
        )


if __name__ == "__main__":
    main()
