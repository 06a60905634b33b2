"""The image loss that the phase loss replaces: displacement and colors fitted together to the photograph itself.

The paper (Sec. 3.5, Fig. "overfit") shows why not to: a pixel gets its color as well by moving the ring under it as by
the color map, so single points move, not rings. It is kept as the ablation to compare with, and so is plain gradient
descent on the phase loss. Differentiable through torch; interpolation and radii are those of the real model.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from scipy.ndimage import distance_transform_edt, gaussian_filter

from woodfit.cylinder_grid import CylinderGrid, sample, trilinear
from woodfit.displacement import Observations, Polished, age_of_radius, tensor

Array = npt.NDArray[Any]

#: How much nearer two nodes are that differ in azimuth only: the model of Liu et al. does not tell them apart.
_ROUND_THE_STEM = 0.02


@dataclass(frozen=True)
class FacePixels:
    """Places on the face and their color.

    Attributes
    ----------
    radius, azimuth, height : arrays of shape (N,)
        Tree coordinates (px, rad, px).
    rgb : array of shape (N, 3)
        Linear RGB of the photograph.
    weight : array of shape (N,)
        How far each counts.
    """

    radius: Array
    azimuth: Array
    height: Array
    rgb: Array
    weight: Array


@dataclass(frozen=True)
class ImageFit:
    """Result of `fit_image`.

    Attributes
    ----------
    displacement : float32 array of the grid's shape
        m_r, px; rings may fold over.
    rgb : float32 array of shape (S, 3)
        Colors over ring age, linear.
    loss : float64 array of shape (steps,)
        Weighted mean square color difference before each step.
    """

    displacement: npt.NDArray[np.float32]
    rgb: npt.NDArray[np.float32]
    loss: npt.NDArray[np.float64]


class FaceField:
    """Values of a field on the grid at fixed places, differentiable in the field."""

    def __init__(self, grid: CylinderGrid, radius: Array, azimuth: Array, height: Array) -> None:
        index, weight = trilinear(grid, radius, azimuth, height)
        self._index, self._weight = torch.from_numpy(index), torch.from_numpy(weight)
        self.radius = torch.from_numpy(np.asarray(radius, np.float64))
        touched = np.bincount(index.ravel(), weight.ravel(), minlength=int(np.prod(grid.shape))) > 0
        self.touched: npt.NDArray[np.bool_] = touched.reshape(grid.shape)

    def __call__(self, field: torch.Tensor) -> torch.Tensor:
        """Values (N,) of a flat field."""
        return (field[self._index] * self._weight.to(field.dtype)).sum(dim=1)


def ring_age(radius: torch.Tensor, ring_radius: Array) -> torch.Tensor:
    """Ring age at ideal radii (px), as `age_of_radius`, differentiable in the radius."""
    now = radius.detach()
    age, width = (torch.from_numpy(part).to(radius.dtype) for part in age_of_radius(now.numpy(), ring_radius))
    # The age is linear within a ring: its value now and its slope say all. At the pith it stays 0.
    return age + (radius - now) / width * (age > 0)


def strip_color(strip: torch.Tensor, age: torch.Tensor, samples_per_ring: int) -> torch.Tensor:
    """Linear RGB (N, 3) at ring ages (N,), as `color_at`, differentiable in the colors (S, 3) and the age."""
    position = torch.clamp(age * samples_per_ring - 0.5, 0.0, len(strip) - 1.0)
    low = torch.clamp(position.detach().long(), max=len(strip) - 2)
    part = (position - low)[:, None]
    return strip[low] * (1.0 - part) + strip[low + 1] * part


def image_loss(
    field: torch.Tensor,
    strip: torch.Tensor,
    on_face: FaceField,
    rgb: torch.Tensor,
    weight: torch.Tensor,
    ring_radius: Array,
    samples_per_ring: int,
) -> torch.Tensor:
    """Weighted mean square difference between the face as rendered and its photograph.

    Parameters
    ----------
    field : tensor of shape (nodes,)
        Displacement, px.
    strip : tensor of shape (S, 3)
        Colors over ring age.
    on_face : FaceField
        Where the pixels lie.
    rgb, weight : tensors of shape (N, 3) and (N,)
        The photograph; the weights add up to 1.
    ring_radius, samples_per_ring
        As in the solid texture.

    Returns
    -------
    tensor of shape ()
    """
    age = ring_age(on_face.radius.to(field.dtype) + on_face(field), ring_radius)
    return (weight * ((strip_color(strip, age, samples_per_ring) - rgb) ** 2).mean(dim=1)).sum()


def phase_loss(
    field: torch.Tensor, on_face: FaceField, phase: torch.Tensor, weight: torch.Tensor, ring_radius: Array
) -> torch.Tensor:
    """Weighted mean of ``1 - cos`` of the phase differences; the weights (N,) add up to 1."""
    age = ring_age(on_face.radius.to(field.dtype) + on_face(field), ring_radius)
    return (weight * (1.0 - torch.cos(phase - 2.0 * torch.pi * age))).sum()


def fit_image(
    grid: CylinderGrid,
    start: Array,
    pixels: FacePixels,
    ring_radius: Array,
    strip_rgb: Array,
    samples_per_ring: int,
    steps: int = 500,
    rate: float = 0.03,
) -> ImageFit:
    """Displacement and colors that give the photograph back, by Adam on the image loss, free of any smoothing.

    Parameters
    ----------
    grid : CylinderGrid
        Of the texture.
    start : array of the grid's shape
        Displacement to begin with, px: zeros, or the initial distortion.
    pixels : FacePixels
        The photograph.
    ring_radius : array of shape (N,)
        Ideal radii at ages 0, 1, ...
    strip_rgb : array of shape (S, 3)
        Colors to begin with.
    samples_per_ring : int
        Of the strip.
    steps, rate
        Of Adam; the displacement is counted in mean ring widths.

    Returns
    -------
    ImageFit
    """
    on_face = FaceField(grid, pixels.radius, pixels.azimuth, pixels.height)
    rgb, weight = tensor(pixels.rgb), _shares(pixels.weight)
    first, ring = tensor(start).reshape(-1), mean_ring_width(ring_radius)
    change = torch.zeros_like(first, requires_grad=True)
    strip = tensor(strip_rgb).clone().requires_grad_()

    def loss() -> torch.Tensor:
        return image_loss(first + ring * change, strip, on_face, rgb, weight, ring_radius, samples_per_ring)

    losses = _descend((change, strip), loss, steps, rate)
    moved = carried_inwards(grid, (ring * change.detach()).numpy().reshape(grid.shape), on_face.touched)
    colors = np.clip(strip.detach().numpy(), 0.0, None)
    return ImageFit((np.asarray(start) + moved).astype(np.float32), colors.astype(np.float32), losses)


def descend_phase(
    grid: CylinderGrid,
    start: Array,
    pixels: Observations,
    ring_radius: Array,
    steps: int = 500,
    rate: float = 0.03,
) -> Polished:
    """Displacement by Adam on the phase loss, as the paper has it; what `woodfit.displacement.polish` is measured by.

    Parameters
    ----------
    grid, start, ring_radius, steps, rate
        As in `fit_image`.
    pixels : Observations
        Face pixels with their wrapped ring phase (rad).

    Returns
    -------
    Polished
    """
    on_face = FaceField(grid, pixels.radius, pixels.azimuth, pixels.height)
    phase, weight = tensor(pixels.target), _shares(pixels.weight)
    first, ring = tensor(start).reshape(-1), mean_ring_width(ring_radius)
    change = torch.zeros_like(first, requires_grad=True)

    def loss() -> torch.Tensor:
        return phase_loss(first + ring * change, on_face, phase, weight, ring_radius)

    losses = _descend((change,), loss, steps, rate)
    field = (first + ring * change.detach()).numpy().reshape(grid.shape)
    return Polished(field, losses)


def mean_ring_width(ring_radius: Array) -> float:
    """Mean width of the rings, px."""
    return float(ring_radius[-1] - ring_radius[0]) / max(1, len(ring_radius) - 1)


def carried_inwards(grid: CylinderGrid, change: Array, touched: npt.NDArray[np.bool_]) -> Array:
    """A change that only the face's nodes know, for all nodes: each takes that of the nearest one on the face.

    The way round the stem counts little, so that a change runs into the wood along the growth layers, as in the model
    of Liu et al., whose distortion knows radius and height but no azimuth.

    Parameters
    ----------
    grid : CylinderGrid
        Of the texture.
    change : array of the grid's shape
        Right where `touched`.
    touched : bool array of the grid's shape
        Nodes that the face depends on.

    Returns
    -------
    array of the grid's shape
    """
    if not touched.any():
        return np.zeros_like(change)
    dr, da, dh = grid.steps
    spacing = (dr, _ROUND_THE_STEM * da * float(grid.radius.mean()), max(dh, 1.0))
    # Past the last azimuth comes the first again.
    rolls = np.arange(grid.shape[1])
    if grid.wraps:
        rolls = np.concatenate([rolls, rolls, rolls])
    nearest = distance_transform_edt(~touched[:, rolls], sampling=spacing, return_distances=False, return_indices=True)
    middle = slice(grid.shape[1], 2 * grid.shape[1]) if grid.wraps else slice(None)
    r, a, h = nearest[:, :, middle]
    return np.asarray(change[r, rolls[a], h])


def folded_share(grid: CylinderGrid, displacement: Array, radius: Array, azimuth: Array, height: Array) -> float:
    """Share of N places (tree coordinates; px, rad, px) at which ``r + m_r`` does not grow with r."""
    slope = sample(grid, displacement, radius, azimuth, height)[1]
    return float((slope <= -1.0).mean())


def roughness(moved: Array, valid: npt.NDArray[np.bool_], sigma_px: float) -> float:
    """How far a displacement on the face (M, N) strays from its own Gaussian mean over the wood, rms, in its unit."""
    sigma = max(sigma_px, 0.5)
    inside = valid.astype(np.float64)
    mean = gaussian_filter(inside * moved, sigma) / np.maximum(gaussian_filter(inside, sigma), 1e-9)
    return float(np.sqrt(((moved - mean)[valid] ** 2).mean())) if valid.any() else 0.0


def _descend(
    parameters: Sequence[torch.Tensor], loss_of: Callable[[], torch.Tensor], steps: int, rate: float
) -> npt.NDArray[np.float64]:
    """Adam; the loss before each step."""
    optimizer = torch.optim.Adam(parameters, lr=rate)
    losses = np.empty(steps)
    for step in range(steps):
        optimizer.zero_grad()
        loss = loss_of()
        torch.autograd.backward(loss)
        optimizer.step()
        losses[step] = float(loss.detach())
    return losses


def _shares(weight: Array) -> torch.Tensor:
    """Weights that add up to 1."""
    total = float(np.asarray(weight, np.float64).sum())
    return tensor(np.asarray(weight) / max(total, 1e-12))
