// What is made of the depth field, with the server's own numbers: `geometry::DepthField::smoothed` and
// `render::gpu::gradients`. The generators yield after each slice, so that the page stays alive meanwhile.

import type { Vec3 } from "./space.ts";

/** Steps of a stored depth in a voxel. */
export const STEPS_PER_VOXEL = 128;

type Depths = Int16Array<ArrayBuffer>;

/** One axis of a block: the distance in its values to the next along it, and how many there are. */
interface Axis {
  readonly stride: number;
  readonly side: number;
}

const axesOf = ([nx, ny, nz]: Vec3): readonly [Axis, Axis, Axis] => [
  { stride: 1, side: nx },
  { stride: nx, side: ny },
  { stride: nx * ny, side: nz },
];

/** How far the kernel reaches to either side. */
const REACH = 5;

/**
 * The field smoothed by about a Gaussian of 1.5 voxels: along each axis the binomial coefficients of order 10, to whole
 * steps. Beyond a face, values are those of the face.
 */
export function* smoothed(values: Depths, size: Vec3): Generator<void, Depths> {
  const slice = size[0] * size[1];
  const [x, y, z] = axesOf(size);
  const line = { x: new Int32Array(size[0] + 2 * REACH), y: new Int32Array(size[1] + 2 * REACH) };
  const planes = new Int16Array(values);
  for (let start = 0; start < planes.length; start += slice) {
    for (let row = 0; row < size[1]; row += 1) convolve(planes, start + row * size[0], x, line.x);
    for (let column = 0; column < size[0]; column += 1) convolve(planes, start + column, y, line.y);
    yield;
  }
  const along = new Int32Array(size[2] + 2 * REACH);
  for (let row = 0; row < size[1]; row += 1) {
    for (let column = 0; column < size[0]; column += 1) convolve(planes, row * size[0] + column, z, along);
    yield;
  }
  return planes;
}

/** Convolves a line of values in place; `line` has room for it and its ends. */
function convolve(values: Depths, start: number, { stride, side }: Axis, line: Int32Array): void {
  for (let place = 0, index = start; place < side; place += 1, index += stride)
    line[place + REACH] = values[index] ?? 0;
  line.fill(line[REACH] ?? 0, 0, REACH);
  line.fill(line[side + REACH - 1] ?? 0, side + REACH);
  const at = (place: number): number => line[place] as number;
  for (let place = 0, index = start; place < side; place += 1, index += stride) {
    const sum =
      at(place) +
      at(place + 10) +
      10 * (at(place + 1) + at(place + 9)) +
      45 * (at(place + 2) + at(place + 8)) +
      120 * (at(place + 3) + at(place + 7)) +
      210 * (at(place + 4) + at(place + 6)) +
      252 * at(place + 5);
    values[index] = (sum + 512) >> 10;
  }
}

/**
 * Central differences per voxel, in 1/127, four bytes a voxel, the last 127 where a fence makes the depth unknown, else 0. On the faces, where there is nothing to
 * take a difference with, all are 0. Of a coarse field, of which every `coarseStep`th depth is there, faces have the
 * differences with the depth before them.
 */
export function* gradients(
  values: Depths,
  size: Vec3,
  coarseStep?: number,
  fenced: Uint8Array | null = null,
): Generator<void, Int8Array<ArrayBuffer>> {
  const [nx, ny, nz] = size;
  const out = new Int8Array(4 * values.length);
  const axes = axesOf(size);
  const inset = coarseStep === undefined ? 1 : 0;
  const voxels = coarseStep ?? 1;
  for (let z = inset; z < nz - inset; z += 1) {
    for (let y = inset; y < ny - inset; y += 1) {
      for (let x = inset; x < nx - inset; x += 1) {
        const index = x + nx * (y + ny * z);
        out[4 * index] = difference(values, index, x, axes[0], voxels);
        out[4 * index + 1] = difference(values, index, y, axes[1], voxels);
        out[4 * index + 2] = difference(values, index, z, axes[2], voxels);
        if (fenced) out[4 * index + 3] = 127 * (fenced[index] as number);
      }
    }
    yield;
  }
  return out;
}

/**
 * The slope along an axis whose neighbours are `voxels` apart. Depths change by a voxel in a voxel at most, so that
 * it fits in eight bits.
 */
function difference(values: Depths, index: number, place: number, { stride, side }: Axis, voxels: number): number {
  const before = place > 0 ? index - stride : index;
  const after = place + 1 < side ? index + stride : index;
  const steps = (values[after] as number) - (values[before] as number);
  const apart = Math.max((after - before) / stride, 1) * voxels;
  const scaled = (steps * 127) / (apart * STEPS_PER_VOXEL);
  // To the nearest, halves away from zero.
  return scaled < 0 ? Math.ceil(scaled - 0.5) : Math.floor(scaled + 0.5);
}

/**
 * The box around the centres of the envelope's border voxels (depth 0), in voxel coordinates; null where there are
 * none.
 */
export function borderBox(values: Depths, size: Vec3): readonly [Vec3, Vec3] | null {
  const [nx, ny] = size;
  let [lowX, lowY, lowZ] = [Infinity, Infinity, Infinity];
  let [highX, highY, highZ] = [-1, -1, -1];
  for (let row = 0, start = 0; start < values.length; row += 1, start += nx) {
    let first = -1;
    let last = -1;
    for (let x = 0; x < nx; x += 1) {
      if (values[start + x] !== 0) continue;
      if (first < 0) first = x;
      last = x;
    }
    if (first < 0) continue;
    [lowX, highX] = [Math.min(lowX, first), Math.max(highX, last)];
    [lowY, highY] = [Math.min(lowY, row % ny), Math.max(highY, row % ny)];
    [lowZ, highZ] = [Math.min(lowZ, Math.floor(row / ny)), Math.max(highZ, Math.floor(row / ny))];
  }
  return highX < 0
    ? null
    : [
        [lowX, lowY, lowZ],
        [highX, highY, highZ],
      ];
}
