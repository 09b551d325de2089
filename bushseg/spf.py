"""Simple point features, SPF: three angles between two points' normals (section 3.3, eq. 4-9).

They don't change under rotation, translation or scale, so they describe the surface alone: near
zero on a wall, scattered in leaves.

They are computed where they are used, in the network's first step, and not cached: see the figures
in benchmarks/RESULTS.md.
"""

import torch
from torch import Tensor


def simple_point_features(xyz: Tensor, normals: Tensor, neighbors: Tensor) -> Tensor:
    """SPF of each point against each of its neighbors.

    For key point p_i with neighbor p_k at distance d, e = (p_k - p_i) / d: u = n_i (eq. 4),
    v = u x e (eq. 5, not normalized, as printed), w = u x v (eq. 6); alpha = v . n_k (eq. 7),
    phi = u . e (eq. 8), theta = atan2(w . n_k, u . n_k) (eq. 9). At d = 0 (the point itself,
    duplicates) all three are zero.

    Args:
        xyz: Positions, shape (N, 3), float; any unit.
        normals: Unit normals, shape (N, 3).
        neighbors: Neighbor indices, shape (N, K), int64.

    Returns:
        (alpha, phi, theta), shape (N, K, 3); alpha and phi in [-1, 1], theta in radians.
    """
    shape = (*neighbors.shape, 3)
    flat = neighbors.reshape(-1)
    offset = xyz.index_select(0, flat).view(shape) - xyz[:, None]
    n_k = normals.index_select(0, flat).view(shape)
    distance = offset.norm(dim=2, keepdim=True)
    # Where d = 0, offset is zero and so is e: v, w, alpha and phi vanish of themselves.
    e = offset / distance.clamp_min(torch.finfo(xyz.dtype).tiny)
    u = normals[:, None].expand(shape)
    v = torch.cross(u, e, dim=2)
    w = torch.cross(u, v, dim=2)
    alpha = (v * n_k).sum(dim=2)
    phi = (u * e).sum(dim=2)
    theta = torch.atan2((w * n_k).sum(dim=2), (u * n_k).sum(dim=2))
    theta = torch.where(distance[..., 0] > 0, theta, torch.zeros_like(theta))
    return torch.stack([alpha, phi, theta], dim=2)
