// The surfaces of a case.

import assert from "node:assert/strict";
import test from "node:test";

import { NAMED_VIEWS, project } from "../src/model/camera.ts";
import { looksOf } from "../src/model/checklist.ts";
import { gradients } from "../src/model/field.ts";
import { depthsOf } from "../src/model/isosurface.ts";
import type { Vec2, Vec3 } from "../src/model/space.ts";
import { firstState, surfacesOf } from "../src/model/state.ts";
import { SURFACES, fitted, mirroredSurface, nextSurface } from "../src/model/surfaces.ts";
import { unfenced, type Block } from "../src/model/wire.ts";
import { SHOWN } from "./shown.ts";

function finished<T>(work: Generator<void, T>): T {
  for (;;) {
    const { done, value } = work.next();
    if (done) return value;
  }
}

test("a key goes through all surfaces, and a half is the mirror image of the other", () => {
  let name = SURFACES[0] as (typeof SURFACES)[number];
  const seen = SURFACES.map(() => (name = nextSurface(name)));
  assert.deepEqual([...seen].sort(), [...SURFACES].sort());
  assert.deepEqual(SURFACES.map(mirroredSurface), ["whole", "right", "left", "cerebrum"]);
  const state = firstState(SHOWN);
  assert.deepEqual(surfacesOf({ ...state, surface: "left" }), ["left"]);
  assert.deepEqual(surfacesOf({ ...state, surface: "left", layout: "mirror" }), ["left", "right"]);
  assert.deepEqual(surfacesOf({ ...state, surface: "cerebrum", layout: "mirror" }), ["cerebrum"]);
});

test("the server's picture of a part, fitted to its sphere, shows each place where the page has it", () => {
  const whole = SHOWN.envelope_sphere;
  const part = { center_in_patient: [32, 12, 18] as Vec3, radius_mm: 71 };
  const size: Vec2 = [300, 200];
  for (const orientation of Object.values(NAMED_VIEWS)) {
    const view = { orientation, zoom: 1.5, pan_mm: [4, -7] as Vec2 };
    const own = project(view, whole, size);
    const theirs = project(fitted(view, whole, part), part, size);
    assert.ok(Math.abs(own.mm_per_pixel - theirs.mm_per_pixel) < 1e-9);
    for (const place of [[0, 0, 0] as Vec3, [40, -12, 55] as Vec3]) {
      const [one, other] = [own.pixelOf(place), theirs.pixelOf(place)];
      assert.ok(Math.hypot(one[0] - other[0], one[1] - other[1]) < 1e-6);
    }
  }
});

test("the fence is taken out of the depths of a part, and makes them unknown at half of its share", () => {
  const size: Vec3 = [4, 3, 3];
  const voxels = new Int16Array(36);
  voxels.fill(-256);
  const inside = [1, 2].map((x) => x + 4 * (1 + 3));
  voxels[inside[0] as number] = 128 | 1;
  voxels[inside[1] as number] = 300;
  const layout = { size, format: "i16", scale: 1 / 128, offset: 0 } as const;
  const patient_from_voxel = [
    [1, 0, 0, 0],
    [0, 1, 0, 0],
    [0, 0, 1, 0],
    [0, 0, 0, 1],
  ] as const;
  const block: Block<Int16Array<ArrayBuffer>> = { ...layout, patient_from_voxel, voxels };
  const { field, fenced } = finished(unfenced(block));
  assert.deepEqual(
    [...field.voxels].filter((value) => value > 0),
    [128, 300],
  );
  assert.equal(
    fenced.reduce((sum, one) => sum + one, 0),
    1,
  );
  const slopes = finished(gradients(field.voxels, size, undefined, fenced));
  assert.equal(slopes[4 * (inside[0] as number) + 3], 127);
  assert.equal(slopes[4 * (inside[1] as number) + 3], 0);
  const depths = depthsOf(field, field, fenced);
  assert.equal(depths.isFenced?.([1, 1, 1]), true);
  assert.equal(depths.isFenced?.([1.4, 1, 1]), true);
  assert.equal(depths.isFenced?.([1.6, 1, 1]), false);
  assert.equal(depthsOf(field, field).isFenced, undefined);
});

test("one half is looked at from its outer side alone", () => {
  const state = { ...firstState(SHOWN), surface: "left" } as const;
  assert.deepEqual(looksOf({ ...state, orientation: NAMED_VIEWS.left }), ["left"]);
  assert.deepEqual(looksOf({ ...state, orientation: NAMED_VIEWS.right, layout: "slices" }), ["slices"]);
  assert.deepEqual(looksOf({ ...state, orientation: NAMED_VIEWS.anterior }), []);
  assert.deepEqual(looksOf({ ...state, orientation: NAMED_VIEWS.left, layout: "mirror" }), ["left", "right"]);
  assert.deepEqual(looksOf({ ...state, surface: "cerebrum", orientation: NAMED_VIEWS.right }), ["right"]);
});
