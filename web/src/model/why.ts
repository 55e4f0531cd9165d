// Why a place is listed: how sharp the junction is there, around it, on the other side, and usually in this head; pure.

import { type Vec3, inverted, transform } from "./space.ts";
import type { Block } from "./wire.ts";

export const WHY_PARTS = ["here", "around", "opposite", "usual"] as const;
/** The sharpness of the junction; NaN where there is none. */
export type Why = Readonly<Record<(typeof WHY_PARTS)[number], number>>;

/** The Gaussians over which sharpness is averaged, in mm: `around` and `opposite` as those of the map `blur`. */
const SIGMA_MM = { here: 1, around: 8, opposite: 3 } as const;
/** So many of its deviations a Gaussian reaches. */
const REACH = 2.5;
/** So many voxels say what is usual. */
const USUAL_VOXELS = 100_000;

/** The mean of a layer around a position, by a Gaussian; NaN where it is undefined in all its reach. */
export function meanNear(block: Block, position_in_patient: Vec3, sigma_mm: number): number {
  const { size, voxels, scale, offset, patient_from_voxel } = block;
  const voxel_from_patient = inverted(patient_from_voxel);
  if (!voxel_from_patient) return NaN;
  const center = transform(voxel_from_patient, position_in_patient);
  const spacing = [0, 1, 2].map((axis) => Math.hypot(...patient_from_voxel.slice(0, 3).map((row) => row[axis] ?? 0)));
  const along = [0, 1, 2].map((axis) => {
    const [middle, edge, count] = [center[axis] ?? 0, spacing[axis] || 1, size[axis] ?? 0];
    const reach = (REACH * sigma_mm) / edge;
    const [first, last] = [Math.max(Math.ceil(middle - reach), 0), Math.min(Math.floor(middle + reach), count - 1)];
    // A Gaussian is the product of those along the axes.
    return Array.from({ length: Math.max(last - first + 1, 0) }, (_, index) => {
      const away = ((first + index - middle) * edge) / sigma_mm;
      return [first + index, Math.exp(-0.5 * away * away)] as const;
    });
  });
  let [sum, weights] = [0, 0];
  for (const [z, ofZ] of along[2] ?? [])
    for (const [y, ofY] of along[1] ?? [])
      for (const [x, ofX] of along[0] ?? []) {
        const stored = voxels[x + size[0] * (y + size[1] * z)] ?? 0;
        // 0 is undefined.
        if (stored === 0) continue;
        const weight = ofX * ofY * ofZ;
        sum += weight * stored;
        weights += weight;
      }
  return weights > 0 ? scale * (sum / weights) + offset : NaN;
}

/** The value of a layer that half of its voxels exceed; NaN if none has a value. */
export function medianOf({ voxels, scale, offset }: Block): number {
  const step = Math.max(Math.floor(voxels.length / USUAL_VOXELS / 8), 1);
  const found: number[] = [];
  for (let at = 0; at < voxels.length; at += step) if (voxels[at] !== 0) found.push(voxels[at] as number);
  found.sort((a, b) => a - b);
  const middle = found[found.length >> 1];
  return middle === undefined ? NaN : scale * middle + offset;
}

/** Why a place is listed, by the map of sharpness; `opposite_in_patient` is its mirror image. */
export const whyAt = (sharpness: Block, position_in_patient: Vec3, opposite_in_patient: Vec3): Why => ({
  here: meanNear(sharpness, position_in_patient, SIGMA_MM.here),
  around: meanNear(sharpness, position_in_patient, SIGMA_MM.around),
  opposite: meanNear(sharpness, opposite_in_patient, SIGMA_MM.opposite),
  usual: medianOf(sharpness),
});
