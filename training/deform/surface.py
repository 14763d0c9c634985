"""The operators of a surface that DiffusionNet uses: mass, eigenbasis, tangent gradients.

Mirrors `Operators::surface` of `rust-core/src/operators`. Shapes: `V` vertices, `K` eigenpairs.
"""

import numpy as np
import scipy.sparse as sp
import torch
from scipy.sparse.linalg import eigsh

from training.deform.tension_screened_biharmonic import laplacian_and_mass
from training.nn.diffusion_net import SurfaceOperators

RIDGE = 1e-5
"""Ridge of the gradient's least squares, in squared units of length: the authors' value."""


def surface_operators(vertices: np.ndarray, triangles: np.ndarray, eigenpairs: int) -> SurfaceOperators:
    """The operators of a mesh. vertices: [V, 3], in the network's unit (decimetres)."""
    laplacian, mass = laplacian_and_mass(vertices, triangles)
    shift = 0.03 * 4.0 * np.pi * eigenpairs / mass.sum()
    values, vectors = eigsh(laplacian, eigenpairs, sp.diags(mass).tocsc(), sigma=-shift)
    grad_x, grad_y = tangent_gradients(vertices, triangles)
    return SurfaceOperators(
        torch.from_numpy(mass).float(),
        torch.from_numpy(np.maximum(values, 0.0)).float(),
        torch.from_numpy(vectors).float(),
        _torch_csr(grad_x),
        _torch_csr(grad_y),
    )


def vertex_normals(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Unit normals, weighted by area. Zero for a vertex without faces. [V, 3]."""
    a, b, c = (vertices[triangles[:, i]] for i in range(3))
    normals = np.zeros_like(vertices)
    for corner in range(3):
        np.add.at(normals, triangles[:, corner], np.cross(b - a, c - a))
    return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)


def tangent_gradients(vertices: np.ndarray, triangles: np.ndarray) -> tuple[sp.csr_matrix, sp.csr_matrix]:
    """Least-squares gradients over one-rings, along two tangents at each vertex. Two [V, V]."""
    normals = vertex_normals(vertices, triangles)
    seed = np.where(np.abs(normals[:, :1]) < 0.9, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    first = seed - (seed * normals).sum(1, keepdims=True) * normals
    first /= np.maximum(np.linalg.norm(first, axis=1, keepdims=True), 1e-30)
    second = np.cross(normals, first)
    pairs = np.unique(
        np.concatenate([triangles[:, p] for p in ([0, 1], [1, 2], [2, 0], [1, 0], [2, 1], [0, 2])]), axis=0
    )
    row, column = pairs.T
    edge = vertices[column] - vertices[row]
    u, v = (edge * first[row]).sum(1), (edge * second[row]).sum(1)
    count = len(vertices)
    a = RIDGE + np.bincount(row, u * u, count)
    b = np.bincount(row, u * v, count)
    c = RIDGE + np.bincount(row, v * v, count)
    determinant = (a * c - b * b)[row]
    x, y = (c[row] * u - b[row] * v) / determinant, (a[row] * v - b[row] * u) / determinant
    return tuple(_differences(row, column, w, count) for w in (x, y))


def _differences(row: np.ndarray, column: np.ndarray, weight: np.ndarray, count: int) -> sp.csr_matrix:
    """`sum_j w_ij (f_j - f_i)` as a matrix."""
    matrix = sp.csr_matrix((weight, (row, column)), (count, count))
    return (matrix - sp.diags(np.bincount(row, weight, count))).tocsr()


def _torch_csr(matrix: sp.csr_matrix) -> torch.Tensor:
    matrix = matrix.tocsr()
    matrix.sort_indices()
    parts = (matrix.indptr, matrix.indices, matrix.data.astype(np.float32))
    indptr, indices, values = (torch.from_numpy(p) for p in parts)
    return torch.sparse_csr_tensor(indptr.long(), indices.long(), values, matrix.shape)
