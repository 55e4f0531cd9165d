#!/usr/bin/env python3
"""Makes the layers of docs/http.md from a T1 and the mask of its brain: a FLAIR, a PET, a statistical map, labels, and a
prediction as MELD writes it. All are synthetic. Needs numpy, scipy and nibabel.

    scripts/example-layers.py T1.nii.gz MASK.nii.gz FOLDER
"""

import sys
from pathlib import Path

import nibabel as nib
import numpy as np
from scipy import ndimage

# The synthetic lesion, in voxels of the head's RAS space (mm): the left middle frontal gyrus of Colin27.
LESION_MM = (-34.0, 30.0, 32.0)
RADIUS_MM = 9.0
# How the FLAIR and the PET lie in their own space: turned about the head's centre, and shifted in mm.
TURN_DEGREES, SHIFT_MM = 7.0, (6.0, -9.0, 4.0)


def moved(affine, centre):
    angle = np.radians(TURN_DEGREES)
    turn = np.eye(4)
    turn[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    shift = np.eye(4)
    shift[:3, 3] = np.add(SHIFT_MM, centre)
    back = np.eye(4)
    back[:3, 3] = np.negative(centre)
    return shift @ turn @ back @ affine


def save(path, values, affine, code=1):
    image = nib.Nifti1Image(values, affine)
    image.set_sform(affine, code)
    image.set_qform(None, 0)
    nib.save(image, path)


def main(t1_file, mask_file, folder):
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    head = nib.load(t1_file)
    t1 = np.asarray(head.dataobj, dtype=np.float32)
    mask = nib.load(mask_file)
    brain = np.asarray(mask.dataobj) > 0
    if brain.shape != t1.shape:
        sys.exit("the mask must be on the grid of the T1")
    spacing = np.sqrt((head.affine[:3, :3] ** 2).sum(axis=0))
    places = np.stack(np.meshgrid(*map(np.arange, t1.shape), indexing="ij"), axis=-1)
    places = places @ head.affine[:3, :3].T + head.affine[:3, 3]
    centre = places[brain].mean(axis=0)
    distance = np.linalg.norm(places - LESION_MM, axis=-1)
    lesion = np.clip((RADIUS_MM - distance) / 4.0 + 0.5, 0, 1) * brain
    rng = np.random.default_rng(1)
    low, high = np.percentile(t1[brain], [2, 98])
    tissue = np.clip((t1 - low) / (high - low), 0, 1)
    grey = np.exp(-(((tissue - 0.55) / 0.18) ** 2)) * brain

    # Grey matter is brighter than white matter, fluid is dark, the lesion is bright; 2 % noise.
    flair = np.where(tissue < 0.3, tissue, 1.15 - 0.6 * tissue) * (t1 > 0.1 * high)
    flair = 600 * (flair + 0.5 * lesion) + rng.normal(0, 12, t1.shape)
    save(folder / "flair.nii.gz", np.clip(flair, 0, 2000).astype(np.int16), moved(head.affine, centre))

    # Uptake in grey matter, less in the lesion, blurred to 6 mm and sampled every 2 mm.
    uptake = 2.0 * brain + 6.0 * grey * (1 - 0.7 * lesion) + 0.4 * (t1 > 0.2 * high)
    uptake = ndimage.gaussian_filter(uptake, 6.0 / 2.355 / spacing)
    step = np.maximum(np.round(2.0 / spacing).astype(int), 1)
    coarse = uptake[:: step[0], :: step[1], :: step[2]].astype(np.float32)
    affine = head.affine @ np.diag([*step, 1.0])
    save(folder / "pet.nii.gz", coarse, moved(affine, centre))

    # A z map with both signs on the grid of the T1, NaN outside of the brain.
    noise = ndimage.gaussian_filter(rng.normal(0, 1, t1.shape), 4 / spacing)
    z = noise / noise[brain].std() + 5 * lesion
    mirrored = np.linalg.norm(places - np.multiply(LESION_MM, (-1, 1, 1)), axis=-1)
    z -= 4 * np.clip((RADIUS_MM - mirrored) / 4.0 + 0.5, 0, 1)
    save(folder / "zmap.nii.gz", np.where(brain, z, np.nan).astype(np.float32), head.affine)

    # Three regions along the head.
    labels = np.zeros(t1.shape, dtype=np.uint8)
    front = places[..., 1] - centre[1]
    for label, (start, end) in enumerate([(-80, -35), (-20, 15), (30, 90)], start=1):
        labels[brain & (front > start) & (front < end)] = label
    save(folder / "regions.nii.gz", labels, head.affine)
    (folder / "regions.txt").write_text("1 posterior\n2 middle\n3 anterior\n")

    # A cluster and its most salient part, as MELD numbers them.
    meld = np.zeros(t1.shape, dtype=np.int16)
    meld[brain & (distance < RADIUS_MM + 5)] = 1
    meld[brain & (distance < 6)] = 100
    save(folder / "prediction.nii.gz", meld, head.affine)


if __name__ == "__main__":
    if len(sys.argv) != 4:
        sys.exit(__doc__)
    main(*sys.argv[1:])
