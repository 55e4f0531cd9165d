// Affines between spaces. `patient_from_voxel` takes voxel coordinates to the patient: inner names meet in a product.

import type { Affine, Vec3 } from "./space.ts";

/** First `b`, then `a`. */
export function product(a: Affine, b: Affine): Affine {
  const entry = (row: number, column: number): number => {
    let sum = column === 3 ? (a[row]?.[3] ?? 0) : 0;
    for (let inner = 0; inner < 3; inner += 1) sum += (a[row]?.[inner] ?? 0) * (b[inner]?.[column] ?? 0);
    return sum;
  };
  return [0, 1, 2].map((row) => [0, 1, 2, 3].map((column) => entry(row, column))).concat([[0, 0, 0, 1]]);
}

/** The affine whose columns are the images of the axes, less that of the origin, and that of the origin. */
export const fromColumns = (x: Vec3, y: Vec3, z: Vec3, origin: Vec3): Affine => [
  [x[0], y[0], z[0], origin[0]],
  [x[1], y[1], z[1], origin[1]],
  [x[2], y[2], z[2], origin[2]],
  [0, 0, 0, 1],
];

/** Scales along the axes, then moves. */
export const scaleThenMove = (factors: Vec3, offset: Vec3): Affine => [
  [factors[0], 0, 0, offset[0]],
  [0, factors[1], 0, offset[1]],
  [0, 0, factors[2], offset[2]],
  [0, 0, 0, 1],
];

/** A direction through an affine: without its translation. */
export function transformDirection(affine: Affine, direction: Vec3): Vec3 {
  const row = (index: number): number => {
    const [a = 0, b = 0, c = 0] = affine[index] ?? [];
    return a * direction[0] + b * direction[1] + c * direction[2];
  };
  return [row(0), row(1), row(2)];
}

/** The sixteen numbers column by column, as shaders take them. */
export function inColumns(affine: Affine): number[] {
  const numbers: number[] = [];
  for (let column = 0; column < 4; column += 1) {
    for (let row = 0; row < 4; row += 1) numbers.push(affine[row]?.[column] ?? 0);
  }
  return numbers;
}
