// Moving a layer by hand, in steps: pure.

import { fromColumns, scaleThenMove } from "./affine.ts";
import { type Affine, type Vec3, AXES, rotate, scale, subtract, turnAbout } from "./space.ts";

const STEP_MM = 0.5;
const STEP_DEGREES = 0.5;
const DEGREE_RAD = Math.PI / 180;

/** A step in one of the six directions, or about one of the three axes through a point. */
export function stepOf(direction: number, turns: boolean, center: Vec3): Affine {
  const axis = AXES[direction >> 1] ?? center;
  const sign = direction % 2 === 0 ? -1 : 1;
  if (!turns) return scaleThenMove([1, 1, 1], scale(axis, sign * STEP_MM));
  const turn = turnAbout(axis, sign * STEP_DEGREES * DEGREE_RAD);
  const [x, y, z] = AXES.map((one) => rotate(turn, one)) as [Vec3, Vec3, Vec3];
  return fromColumns(x, y, z, subtract(center, rotate(turn, center)));
}

/** The angle by which a rigid transform turns, in degrees. */
export function angleOf(affine: Affine): number {
  const trace = [0, 1, 2].reduce((sum, axis) => sum + (affine[axis]?.[axis] ?? 0), 0);
  return Math.acos(Math.min((trace - 1) / 2, 1)) / DEGREE_RAD;
}
