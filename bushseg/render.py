"""Pictures of point clouds: splats, a depth buffer and eye-dome lighting, in plain NumPy."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bushseg.errors import DataError
from bushseg.files import atomic_path
from bushseg.points import FloatArray

BACKGROUND = (250, 250, 250)
MARGIN = 0.03
TINY = 1e-6

ImageArray = NDArray[np.uint8]


def render(
    xyz: FloatArray,
    colors: NDArray[np.uint8],
    path: str | Path,
    *,
    view: tuple[float, float] = (225.0, 35.0),
    width: int = 1600,
    height: int = 900,
    field_of_view: float = 35.0,
    point_size: int = 2,
    lighting: float = 1.0,
) -> None:
    """Draw points into a PNG file; nearer points hide farther ones.

    Args:
        xyz: Coordinates in metres, shape (N, 3), float64; points that aren't finite are left out.
        colors: Red, green and blue a point, shape (N, 3), uint8.
        path: The picture; it appears whole or not at all.
        view: Azimuth (counter-clockwise from x) and elevation of the eye as seen from the points,
            degrees; elevation 90 looks straight down.
        width: Picture width, pixels.
        height: Picture height, pixels.
        field_of_view: Horizontal angle of the perspective, degrees; 0 draws orthographically.
        point_size: Edge of a point's square, pixels.
        lighting: Strength of eye-dome lighting, 0 for none.

    Raises:
        DataError: No point is finite.
        ValueError: Shapes or sizes make no sense.
        WriteError: The folder can't be written to.
    """
    from matplotlib.image import imsave

    image = draw(
        xyz,
        colors,
        view=view,
        width=width,
        height=height,
        field_of_view=field_of_view,
        point_size=point_size,
        lighting=lighting,
    )
    with atomic_path(path) as partial:
        imsave(partial, image, format="png")


def draw(
    xyz: FloatArray,
    colors: NDArray[np.uint8],
    *,
    view: tuple[float, float],
    width: int,
    height: int,
    field_of_view: float,
    point_size: int,
    lighting: float,
) -> ImageArray:
    """Draw points as :func:`render` does, into an array of shape (height, width, 3), uint8."""
    if xyz.ndim != 2 or xyz.shape[1] != 3 or colors.shape != xyz.shape:
        raise ValueError(f"xyz is {xyz.shape} and colors {colors.shape}; expected (N, 3) both")
    if min(width, height, point_size) < 1 or not 0 <= field_of_view < 170:
        raise ValueError("width, height and point_size must be 1 or more, field_of_view 0 to 170")
    finite = np.isfinite(xyz).all(axis=1)
    if not finite.any():
        raise DataError(f"none of {len(xyz)} points is finite; there is nothing to draw")
    u, v, depth = _project(xyz[finite], view, width, height, field_of_view)
    image, depths = _splat(u, v, depth, colors[finite], width, height, point_size)
    if lighting > 0:
        image = image * _eye_dome(depths, lighting)[..., None]
    image[np.isinf(depths)] = BACKGROUND
    return np.rint(image).astype(np.uint8)


def _project(
    xyz: FloatArray, view: tuple[float, float], width: int, height: int, field_of_view: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Pixel columns, rows and depths, (N,) each, with all points in the picture."""
    azimuth, elevation = np.radians(view)
    away = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    backward = np.cos(elevation) * away + np.array([0, 0, np.sin(elevation)])  # scene to eye
    right = np.array([-away[1], away[0], 0.0])
    middle = (xyz.min(axis=0) + xyz.max(axis=0)) / 2
    x, y, z = np.stack([right, np.cross(backward, right), backward]) @ (xyz - middle).T
    if field_of_view > 0:
        # The eye stands where a ball around all points just fills the field of view.
        radius = max(float(np.linalg.norm(xyz - middle, axis=1).max()), TINY)
        depth = 1.01 * radius / np.sin(np.radians(field_of_view) / 2) - z
        x, y = x / depth, y / depth
    else:
        depth = 2 * float(np.ptp(z)) + 1 - z
    scale = (1 - MARGIN) * min(
        width / max(float(np.ptp(x)), TINY), height / max(float(np.ptp(y)), TINY)
    )
    u = width / 2 + scale * (x - (x.min() + x.max()) / 2)
    v = height / 2 - scale * (y - (y.min() + y.max()) / 2)
    return u, v, depth


def _splat(
    u: FloatArray,
    v: FloatArray,
    depth: FloatArray,
    colors: NDArray[np.uint8],
    width: int,
    height: int,
    point_size: int,
) -> tuple[FloatArray, FloatArray]:
    """Draw squares into a color image (height, width, 3) and a depth buffer, inf where empty."""
    order = np.argsort(-depth, kind="stable")
    depth, colors = depth[order], colors[order]
    left = np.floor(u[order] - (point_size - 1) / 2).astype(np.intp)
    top = np.floor(v[order] - (point_size - 1) / 2).astype(np.intp)
    image = np.zeros((height, width, 3))
    depths = np.full((height, width), np.inf)
    for down in range(point_size):
        for along in range(point_size):
            row, column = top + down, left + along
            inside = (row >= 0) & (row < height) & (column >= 0) & (column < width)
            # Farthest first: of several points on a pixel the last, nearest one is kept.
            layer = np.full((height, width), -1, dtype=np.intp)
            layer[row[inside], column[inside]] = np.flatnonzero(inside)
            nearer = (layer >= 0) & (depth[layer] < depths)
            depths[nearer] = depth[layer[nearer]]
            image[nearer] = colors[layer[nearer]]
    return image, depths


def _eye_dome(depths: FloatArray, strength: float) -> FloatArray:
    """Shade by depth alone: darker where neighboring pixels are nearer to the eye.

    Eye-dome lighting after Boucheny (2009): the mean over eight neighbors of how much nearer they
    are in log depth, made a brightness by exp(-30 strength x).

    Args:
        depths: Depth buffer, shape (height, width), inf where empty.
        strength: Factor on the shading.

    Returns:
        Brightness in 0..1, shape (height, width).
    """
    log_depth = np.log2(depths)
    reach = 2
    padded = np.pad(log_depth, reach, constant_values=np.inf)
    height, width = depths.shape
    shade = np.zeros_like(depths)
    filled = np.isfinite(log_depth)
    for down in (-reach, 0, reach):
        for along in (-reach, 0, reach):
            rows = slice(reach + down, reach + down + height)
            neighbor = padded[rows, reach + along : reach + along + width]
            both = filled & np.isfinite(neighbor)
            shade[both] += np.clip(log_depth[both] - neighbor[both], 0, 0.05)
    brightness: FloatArray = np.exp(-30 * strength * shade / 8)
    return brightness
