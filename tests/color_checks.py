"""How far two sets of linear colors lie apart, as a person sees it and as issue figures are given."""

import numpy as np


def srgb(linear: np.ndarray) -> np.ndarray:
    """Encoded values, 0..255, not rounded."""
    clipped = np.clip(linear, 0.0, 1.0)
    return 255.0 * np.where(clipped <= 0.0031308, 12.92 * clipped, 1.055 * clipped ** (1 / 2.4) - 0.055)


def assert_same_colors(found: np.ndarray, known: np.ndarray, mean: float = 2.0, most: float = 6.0) -> None:
    """Mean over points of the difference at most `mean`, and at 99 % of them at most `most`; of 255."""
    assert_same_encoded(srgb(found), srgb(known), mean, most)


def assert_same_encoded(found: np.ndarray, known: np.ndarray, mean: float = 2.0, most: float = 6.0) -> None:
    """As `assert_same_colors`, of encoded values."""
    assert found.shape == known.shape
    off = np.abs(found - known).mean(axis=-1)
    assert off.mean() <= mean, f"mean difference {off.mean():.2f}"
    assert np.percentile(off, 99) <= most, f"99 % difference {np.percentile(off, 99):.2f}"
