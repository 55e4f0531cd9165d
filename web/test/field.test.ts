import assert from "node:assert/strict";
import { test } from "node:test";

import { borderBox, gradients, smoothed } from "../src/model/field.ts";
import type { Vec3 } from "../src/model/space.ts";

/** Runs a generator to its end. */
function finish<T>(work: Generator<void, T>): T {
  for (;;) {
    const step = work.next();
    if (step.done) return step.value;
  }
}

const SIZE: Vec3 = [9, 8, 7];
const values = Int16Array.from({ length: 504 }, (_, index) => ((index * 7919) % 4096) - 2048);
const index = (x: number, y: number, z: number): number => x + 9 * (y + 8 * z);

/** One axis by the definition: binomial coefficients of order 10, ends repeated, halves up. */
function convolved(from: Int16Array, axis: number): Int16Array {
  const kernel = [1, 10, 45, 120, 210, 252, 210, 120, 45, 10, 1];
  const out = new Int16Array(from.length);
  for (let z = 0; z < 7; z += 1)
    for (let y = 0; y < 8; y += 1)
      for (let x = 0; x < 9; x += 1) {
        let sum = 512;
        for (const [tap, weight] of kernel.entries()) {
          const place = [x, y, z];
          place[axis] = Math.min(Math.max((place[axis] ?? 0) + tap - 5, 0), (SIZE[axis] ?? 0) - 1);
          sum += weight * (from[index(place[0] ?? 0, place[1] ?? 0, place[2] ?? 0)] ?? 0);
        }
        out[index(x, y, z)] = Math.floor(sum / 1024);
      }
  return out;
}

test("smoothing is the convolution of its definition, axis by axis", () => {
  const before = Int16Array.from(values);
  const expected = [0, 1, 2].reduce(convolved, values);
  assert.deepEqual(finish(smoothed(values, SIZE)), expected);
  assert.deepEqual(values, before, "what is given stays as it is");
});

test("smoothing keeps a slope away from its ends", () => {
  const slope = Int16Array.from({ length: 24 * 12 * 12 }, (_, at) => 10 * (at % 24));
  const smooth = finish(smoothed(slope, [24, 12, 12]));
  for (let x = 5; x < 19; x += 1) assert.equal(smooth[x + 24 * (5 + 12 * 5)], 10 * x);
});

test("gradients are central differences in 1/127, and nothing on the faces", () => {
  const steps = Int16Array.from({ length: 504 }, (_, at) => 128 * (at % 9));
  const slopes = finish(gradients(steps, SIZE));
  assert.deepEqual([...slopes.subarray(4 * index(4, 3, 3), 4 * index(4, 3, 3) + 4)], [127, 0, 0, 0]);
  assert.deepEqual([...slopes.subarray(4 * index(0, 3, 3), 4 * index(0, 3, 3) + 4)], [0, 0, 0, 0]);
  assert.deepEqual([...slopes.subarray(4 * index(4, 3, 6), 4 * index(4, 3, 6) + 4)], [0, 0, 0, 0]);
});

test("gradients of a coarse field are per voxel as well, on its faces too", () => {
  const steep = Int16Array.from({ length: 504 }, (_, at) => 4 * 128 * (at % 9));
  const slopes = finish(gradients(steep, SIZE, 4));
  for (const place of [index(4, 3, 3), index(0, 3, 3), index(4, 3, 6)]) assert.equal(slopes[4 * place], 127);
});

test("the border box holds every voxel of depth 0", () => {
  const depths = new Int16Array(504).fill(-128);
  assert.equal(borderBox(depths, SIZE), null);
  for (const [x, y, z] of [
    [2, 3, 4],
    [6, 1, 5],
  ] as const)
    depths[index(x, y, z)] = 0;
  assert.deepEqual(borderBox(depths, SIZE), [
    [2, 1, 4],
    [6, 3, 5],
  ]);
});
