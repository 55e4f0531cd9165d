import assert from "node:assert/strict";
import { test } from "node:test";

import type { Vec3 } from "../src/model/space.ts";
import { meanNear, medianOf, whyAt } from "../src/model/why.ts";
import type { Block } from "../src/model/wire.ts";

/** A block of 21 voxels of 2 mm a side; 0 is undefined. */
function blockOf(stored: (x: number, y: number, z: number) => number): Block {
  const [size, voxels] = [[21, 21, 21] as const, new Uint8Array(21 ** 3)];
  for (let z = 0; z < 21; z += 1)
    for (let y = 0; y < 21; y += 1)
      for (let x = 0; x < 21; x += 1) voxels[x + 21 * (y + 21 * z)] = stored(x - 10, y - 10, z - 10);
  return {
    size,
    voxels,
    scale: 0.01,
    offset: -0.01,
    format: "u8",
    patient_from_voxel: [
      [2, 0, 0, -20],
      [0, 2, 0, -20],
      [0, 0, 2, -20],
      [0, 0, 0, 1],
    ],
  } as unknown as Block;
}

const near = (value: number, wanted: number): void => assert.ok(Math.abs(value - wanted) < 1e-9, `${value}`);

test("a mean is of what is defined alone, and is unknown where nothing is", () => {
  const right = blockOf((x) => (x < 0 ? 0 : 51));
  near(meanNear(right, [0, 0, 0], 4), 0.5);
  assert.ok(Number.isNaN(meanNear(right, [-18, 0, 0], 2)));
  near(medianOf(right), 0.5);
  assert.ok(Number.isNaN(medianOf(blockOf(() => 0))));
});

test("a place is compared with its surroundings, its mirror image and the usual", () => {
  const place: Vec3 = [12, 0, 0];
  const blurred = blockOf((x, y, z) => (Math.hypot(x - 6, y, z) < 2.5 ? 21 : x < -2 ? 61 : 41));
  const { here, around, opposite, usual } = whyAt(blurred, place, [-12, 0, 0]);
  near(usual, 0.4);
  near(opposite, 0.6);
  assert.ok(here < 0.22 && around > 0.3 && around < 0.4, `${here} ${around}`);
});
