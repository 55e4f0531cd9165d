"""A synthetic head with folded gyri and a ball of no tissue on its left side, as NIfTI in scanner RAS."""

from pathlib import Path

import nibabel as nib
import numpy as np

EDGE_MM = 2.0
HALF_MM = np.array([92.0, 108.0, 92.0])
BRAIN_MM = np.array([70.0, 86.0, 66.0])
CORTEX_MM, SULCUS_MM, SULCUS_WIDTH_MM, VENTRICLES_MM = 4.0, 26.0, 3.0, 48.0
# The patient's left is negative in RAS.
BALL_MM, BALL_RADIUS_MM, BALL = np.array([-54.0, 10.0, 20.0]), 8.0, 1200
WHITE, GREY, FLUID, BONE, SCALP = 820.0, 560.0, 210.0, 60.0, 700.0


def _wave(position):
    """The sulci are its zeros, the same ones on both sides."""
    x, y, z = np.abs(position[..., 0]), position[..., 1], position[..., 2]
    bent_x = x + 9 * (np.sin(y / 17) + np.cos(z / 23))
    bent_y = y + 9 * (np.sin(z / 19) + np.cos(x / 21))
    bent_z = z + 9 * (np.sin(x / 15) + np.cos(y / 25))
    return np.sin(bent_y / 8) + np.sin(bent_z / 9) + np.sin(bent_x / 10)


def _intensities(position):
    """T1-like intensities at RAS positions, and whether they are of the brain."""
    scaled = position / BRAIN_MM
    radius = np.maximum(np.linalg.norm(scaled, axis=-1), 1e-9)
    depth = (1 - radius) * radius / np.maximum(np.linalg.norm(scaled / BRAIN_MM, axis=-1), 1e-9)
    outline = scaled / radius[..., None] * BRAIN_MM
    slope = np.stack([_wave(outline + step) - _wave(outline - step) for step in np.eye(3) * 0.5], axis=-1)
    sheet = np.abs(_wave(outline)) / np.maximum(np.linalg.norm(slope, axis=-1), 0.02)
    sulcus = np.hypot(sheet, np.maximum(depth - SULCUS_MM, 0))
    fissure = np.hypot(np.abs(position[..., 0]), np.maximum(depth - 34, 0))
    to_fluid = np.minimum(depth, np.minimum(sulcus, fissure))
    to_fluid -= SULCUS_WIDTH_MM / 2
    white = np.clip((to_fluid - CORTEX_MM) / 0.5 + 0.5, 0, 1)
    inside = np.where((to_fluid < 0) | (depth > VENTRICLES_MM), FLUID, GREY + (WHITE - GREY) * white)
    outside = np.select([depth > -2, depth > -8, depth > -14], [FLUID, BONE, SCALP], 0.0)
    return np.where(depth >= 0, inside, outside), depth >= SULCUS_WIDTH_MM / 2


def write_phantom(folder: Path) -> None:
    """Writes `head.nii.gz` and `brain.nii.gz`, the mask of its brain."""
    size = np.round(2 * HALF_MM / EDGE_MM).astype(int)
    affine = np.diag([EDGE_MM, EDGE_MM, EDGE_MM, 1.0])
    affine[:3, 3] = -(size - 1) / 2 * EDGE_MM
    position = nib.affines.apply_affine(affine, np.stack(np.indices(size), axis=-1))
    values, brain = _intensities(position)
    values += np.random.default_rng(1).uniform(-15, 15, values.shape) * (values > 0)
    values[np.linalg.norm(position - BALL_MM, axis=-1) < BALL_RADIUS_MM] = BALL
    nib.save(nib.Nifti1Image(values.clip(0).astype(np.int16), affine), folder / "head.nii.gz")
    nib.save(nib.Nifti1Image(brain.astype(np.uint8), affine), folder / "brain.nii.gz")
