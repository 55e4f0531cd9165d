// Values between voxel centres, as the shaders have them.

import { inverted, transform, type Affine, type Vec3 } from "./space.ts";
import { refuseUnless, type Block } from "./wire.ts";

/** A block of voxels that can be asked at any position of the patient. */
export interface Sampler {
  readonly voxel_from_patient: Affine;
  /**
   * The value at a position in voxel coordinates, trilinear; beyond the outermost centres, that of the nearest face.
   */
  at(position_in_voxel: Vec3): number;
  /** The value at a position of the patient; NaN more than half a voxel beyond the outermost centres. */
  atPatient(position_in_patient: Vec3): number;
}

export function samplerOf({ size, voxels, scale, offset, patient_from_voxel }: Block): Sampler {
  const voxel_from_patient = inverted(patient_from_voxel);
  refuseUnless(voxel_from_patient !== null);
  const [nx, ny, nz] = size;
  const stored = (index: number): number => voxels[index] as number;
  const at = ([x, y, z]: Vec3): number => {
    const px = Math.min(Math.max(x, 0), nx - 1);
    const py = Math.min(Math.max(y, 0), ny - 1);
    const pz = Math.min(Math.max(z, 0), nz - 1);
    const ix = Math.min(Math.floor(px), Math.max(nx - 2, 0));
    const iy = Math.min(Math.floor(py), Math.max(ny - 2, 0));
    const iz = Math.min(Math.floor(pz), Math.max(nz - 2, 0));
    const dx = nx > 1 ? 1 : 0;
    const dy = ny > 1 ? nx : 0;
    const dz = nz > 1 ? nx * ny : 0;
    const start = ix + nx * (iy + ny * iz);
    const row = (first: number): number => stored(first) + (stored(first + dx) - stored(first)) * (px - ix);
    const slice = (first: number): number => row(first) + (row(first + dy) - row(first)) * (py - iy);
    return scale * (slice(start) + (slice(start + dz) - slice(start)) * (pz - iz)) + offset;
  };
  const isInside = (position: Vec3): boolean =>
    position.every((coordinate, axis) => coordinate >= -0.5 && coordinate <= (size[axis] ?? 0) - 0.5);
  return {
    voxel_from_patient,
    at,
    atPatient(position_in_patient) {
      const position = transform(voxel_from_patient, position_in_patient);
      return isInside(position) ? at(position) : NaN;
    },
  };
}

/** The value of a layer, whose stored 0 is undefined, at a position of the patient; NaN where it is undefined. */
export function layerSampler(block: Block): (position_in_patient: Vec3) => number {
  const sampler = samplerOf(block);
  const [nx, ny] = block.size;
  return (position_in_patient) => {
    const value = sampler.atPatient(position_in_patient);
    const nearest = transform(sampler.voxel_from_patient, position_in_patient).map((part, axis) =>
      Math.min(Math.max(Math.round(part), 0), (block.size[axis] ?? 1) - 1),
    );
    const [x = 0, y = 0, z = 0] = nearest;
    return block.voxels[x + nx * (y + ny * z)] === 0 ? NaN : value;
  };
}
