import assert from "node:assert/strict";
import { test } from "node:test";

import { decodeMask, maskOutline } from "../src/model/mask.ts";
import { transform } from "../src/model/space.ts";
import { WireError } from "../src/model/wire.ts";

/** A NIfTI file of 4 × 5 × 3 voxels of 2 mm, whose box from (1, 1, 1) to (2, 3, 1) is the mask. */
function file(change: (header: DataView) => void = () => {}): ArrayBuffer {
  const bytes = new ArrayBuffer(352 + 60);
  const header = new DataView(bytes);
  header.setInt32(0, 348, true);
  [3, 4, 5, 3].forEach((side, at) => header.setInt16(40 + 2 * at, side, true));
  header.setInt16(70, 2, true);
  header.setFloat32(108, 352, true);
  // NIfTI's own space is RAS: x and y are turned round.
  const rows = [
    [-2, 0, 0, 10],
    [0, -2, 0, 20],
    [0, 0, 2, -30],
  ];
  rows.flat().forEach((value, at) => header.setFloat32(280 + 4 * at, value, true));
  const voxels = new Uint8Array(bytes, 352);
  for (const x of [1, 2]) for (const y of [1, 2, 3]) voxels[x + 4 * (y + 5 * 1)] = 1;
  change(header);
  return bytes;
}

test("a mask is read in its place in the patient", () => {
  const mask = decodeMask(file());
  assert.deepEqual(mask.size, [4, 5, 3]);
  assert.deepEqual(transform(mask.patient_from_voxel, [1, 1, 1]), [-8, -18, -28]);
});

test("its outline goes round its voxels, in lines as long as can be", () => {
  const mask = decodeMask(file());
  assert.equal(maskOutline(mask, 2, -28), "M0.5 0.5H2.5M0.5 3.5H2.5M0.5 0.5V3.5M2.5 0.5V3.5");
  assert.equal(maskOutline(mask, 0, -8), "M0.5 0.5H3.5M0.5 1.5H3.5M0.5 0.5V1.5M3.5 0.5V1.5");
  assert.equal(maskOutline(mask, 2, -28.9), maskOutline(mask, 2, -28), "the nearest voxels are shown");
  assert.equal(maskOutline(mask, 2, -30), "", "a slice without the mask has no outline");
  assert.equal(maskOutline(mask, 2, 99), "", "nor has one beside it");
});

test("a file that is no such mask is refused", () => {
  const refused = (change: (header: DataView) => void): void =>
    assert.throws(() => decodeMask(file(change)), WireError);
  refused((header) => header.setInt32(0, 7, true));
  refused((header) => header.setInt16(70, 4, true));
  refused((header) => header.setInt16(42, 400, true));
  refused((header) => header.setInt16(42, -4, true));
  refused((header) => header.setFloat32(284, 1, true));
  assert.throws(() => decodeMask(new ArrayBuffer(10)), WireError);
});
