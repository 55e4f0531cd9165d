// Vectors and quaternions as plain values. Patient space is LPS, in mm; view space has x right, y up, z to the viewer.

export type Vec2 = readonly [number, number];
export type Vec3 = readonly [number, number, number];
export const AXES: readonly Vec3[] = [
  [1, 0, 0],
  [0, 1, 0],
  [0, 0, 1],
];

/** A unit quaternion [x, y, z, w]. */
export type Quat = readonly [number, number, number, number];
/** Rows of an affine from one space to another, the last row being 0 0 0 1. */
export type Affine = readonly (readonly number[])[];

export const clamp = (value: number, low: number, high: number): number => Math.min(Math.max(value, low), high);
export const add = (a: Vec3, b: Vec3): Vec3 => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
export const subtract = (a: Vec3, b: Vec3): Vec3 => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
export const scale = (a: Vec3, factor: number): Vec3 => [a[0] * factor, a[1] * factor, a[2] * factor];
export const dot = (a: Vec3, b: Vec3): number => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
export const length = (a: Vec3): number => Math.hypot(...a);
export const distance = (a: Vec3, b: Vec3): number => length(subtract(a, b));

export const cross = (a: Vec3, b: Vec3): Vec3 => [
  a[1] * b[2] - a[2] * b[1],
  a[2] * b[0] - a[0] * b[2],
  a[0] * b[1] - a[1] * b[0],
];

export function meanOf(points: readonly Vec3[]): Vec3 {
  const sum = points.reduce<Vec3>(add, [0, 0, 0]);
  return scale(sum, 1 / points.length);
}

/** The vector at length 1; of the null vector, the null vector. */
export function normalized(a: Vec3): Vec3 {
  const size = length(a);
  return size > 0 ? scale(a, 1 / size) : a;
}

/** The turn by `angle_rad` about `axis`, which need not be of length 1. */
export function turnAbout(axis: Vec3, angle_rad: number): Quat {
  const [x, y, z] = scale(normalized(axis), Math.sin(angle_rad / 2));
  return [x, y, z, Math.cos(angle_rad / 2)];
}

/** First `b`, then `a`. */
export const compose = (a: Quat, b: Quat): Quat => [
  a[3] * b[0] + a[0] * b[3] + a[1] * b[2] - a[2] * b[1],
  a[3] * b[1] - a[0] * b[2] + a[1] * b[3] + a[2] * b[0],
  a[3] * b[2] + a[0] * b[1] - a[1] * b[0] + a[2] * b[3],
  a[3] * b[3] - a[0] * b[0] - a[1] * b[1] - a[2] * b[2],
];

export const inverse = (q: Quat): Quat => [-q[0], -q[1], -q[2], q[3]];

export function rotate(q: Quat, v: Vec3): Vec3 {
  const axis: Vec3 = [q[0], q[1], q[2]];
  const twice = scale(cross(axis, v), 2);
  return add(add(v, scale(twice, q[3])), cross(axis, twice));
}

/**
 * The quaternion at length 1, its first number that is not 0 counted from w being positive; null where it has no
 * length.
 */
export function unit(q: Quat): Quat | null {
  const size = Math.hypot(...q);
  if (!Number.isFinite(size) || size < 1e-3) return null;
  const sign = [q[3], q[2], q[1], q[0]].find((part) => part !== 0) ?? 1;
  const factor = (sign < 0 ? -1 : 1) / size;
  return [q[0] * factor, q[1] * factor, q[2] * factor, q[3] * factor];
}

/** The rotation whose rows are `right`, `up` and `towards`: it takes these directions to x, y and z. */
export function fromRows(right: Vec3, up: Vec3, towards: Vec3): Quat {
  const [m00, m01, m02] = right;
  const [m10, m11, m12] = up;
  const [m20, m21, m22] = towards;
  const trace = m00 + m11 + m22;
  // The largest of the four is computed first, so that nothing is divided by a small number.
  const squares = [1 + m00 - m11 - m22, 1 - m00 + m11 - m22, 1 - m00 - m11 + m22, 1 + trace];
  const largest = squares.indexOf(Math.max(...squares));
  const four = 2 * Math.sqrt(Math.max(...squares));
  const candidates: Quat[] = [
    [four / 4, (m01 + m10) / four, (m02 + m20) / four, (m21 - m12) / four],
    [(m01 + m10) / four, four / 4, (m12 + m21) / four, (m02 - m20) / four],
    [(m02 + m20) / four, (m12 + m21) / four, four / 4, (m10 - m01) / four],
    [(m21 - m12) / four, (m02 - m20) / four, (m10 - m01) / four, four / 4],
  ];
  return unit(candidates[largest] ?? [0, 0, 0, 1]) ?? [0, 0, 0, 1];
}

/** The angle of the turn from `a` to `b`, in radians, 0 to π. */
export function angleBetween(a: Quat, b: Quat): number {
  const along = Math.abs(a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]);
  return 2 * Math.acos(Math.min(along, 1));
}

export function transform(affine: Affine, p: Vec3): Vec3 {
  const row = (index: number): number => {
    const [a = 0, b = 0, c = 0, d = 0] = affine[index] ?? [];
    return a * p[0] + b * p[1] + c * p[2] + d;
  };
  return [row(0), row(1), row(2)];
}

/** The affine the other way; null where there is none. */
export function inverted(affine: Affine): Affine | null {
  const at = (row: number, column: number): number => affine[row]?.[column] ?? 0;
  const rows: Vec3[] = [0, 1, 2].map((row) => [at(row, 0), at(row, 1), at(row, 2)]);
  const [a, b, c] = rows as [Vec3, Vec3, Vec3];
  const columns = [cross(b, c), cross(c, a), cross(a, b)] as const;
  const determinant = dot(a, columns[0]);
  if (!Number.isFinite(1 / determinant)) return null;
  const linear = [0, 1, 2].map((row): Vec3 => [
    (columns[0][row] ?? 0) / determinant,
    (columns[1][row] ?? 0) / determinant,
    (columns[2][row] ?? 0) / determinant,
  ]);
  const offset: Vec3 = [at(0, 3), at(1, 3), at(2, 3)];
  return [...linear.map((row) => [...row, -dot(row, offset)]), [0, 0, 0, 1]];
}

/** The slice planes; `axis` is the patient's across them. */
export const PLANES = { axial: { axis: 2 }, coronal: { axis: 1 }, sagittal: { axis: 0 } } as const;
export type Plane = keyof typeof PLANES;
export const PLANE_NAMES = ["axial", "coronal", "sagittal"] as const satisfies readonly Plane[];
