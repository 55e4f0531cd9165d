// The plane between the hemispheres, at which one is mirrored to be compared with the other.

import type { MirrorPlane, Sphere } from "./case.ts";
import { dot, scale, subtract, type Affine, type Vec3 } from "./space.ts";

/** The patient's sagittal plane through the sphere's centre. */
export const plainPlane = ({ center_in_patient }: Sphere): MirrorPlane => ({
  normal: [1, 0, 0],
  offset_mm: center_in_patient[0],
});

/** How far a position is from the plane, to the patient's left. */
export const distance_mm = (position_in_patient: Vec3, { normal, offset_mm }: MirrorPlane): number =>
  dot(position_in_patient, normal) - offset_mm;

/** A side of the patient, or neither: too near to the plane to be told by it; `unknown`: plane and coordinates contradict each other. */
export type Side = SideSeen | "unknown";

/** The hemisphere that is seen, or `middle`: both are. */
export type SideSeen = "left" | "right" | "middle";

/** What lies so near to the plane is in the middle: the hemispheres are not divided by a plane alone. */
const MIDDLE_MM = 5;

/**
 * On which side of the plane a position is. If the plane is in doubt, the patient's own coordinate must say the same: the plane of half a
 * brain lies within that half.
 */
export function sideOf(position_in_patient: Vec3, plane: MirrorPlane): Side {
  const side = sideAt(distance_mm(position_in_patient, plane));
  return plane.doubtful && side !== sideAt(position_in_patient[0]) ? "unknown" : side;
}

function sideAt(left_mm: number): SideSeen {
  if (Math.abs(left_mm) <= MIDDLE_MM) return "middle";
  return left_mm > 0 ? "left" : "right";
}

/** How far a direction must lead from the plane so that one hemisphere is seen from there alone: a sine. */
const SIDEWAYS = 0.2;

/** The hemisphere that is seen from a direction; `middle`: both are. */
export function sideSeen(towards_viewer: Vec3, { normal }: MirrorPlane): SideSeen {
  const leftwards = dot(towards_viewer, normal);
  if (Math.abs(leftwards) < SIDEWAYS) return "middle";
  return leftwards > 0 ? "left" : "right";
}

/** The position mirrored at the plane. */
export const reflected = (position_in_patient: Vec3, plane: MirrorPlane): Vec3 =>
  subtract(position_in_patient, scale(plane.normal, 2 * distance_mm(position_in_patient, plane)));

/** The patient mirrored at the plane. */
export function reflection({ normal, offset_mm }: MirrorPlane): Affine {
  const row = (axis: 0 | 1 | 2): number[] => {
    const linear = normal.map((part, column) => (column === axis ? 1 : 0) - 2 * normal[axis] * part);
    return [...linear, 2 * offset_mm * normal[axis]];
  };
  return [row(0), row(1), row(2), [0, 0, 0, 1]];
}
