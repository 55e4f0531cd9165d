import assert from "node:assert/strict";
import { test } from "node:test";

import { NAMED_VIEWS } from "../src/model/camera.ts";
import type { ReadyCase } from "../src/model/case.ts";
import { depthsOf, firstHit, smoothShare, wayIn } from "../src/model/isosurface.ts";
import { Points } from "../src/model/points.ts";
import { PROFILE_STEP_MM, profileAt } from "../src/model/profile.ts";
import { samplerOf } from "../src/model/sampler.ts";
import { length, subtract, type Vec3 } from "../src/model/space.ts";
import { firstState } from "../src/model/state.ts";
import type { Block } from "../src/model/wire.ts";
import { SHOWN } from "./shown.ts";

/** A ball of 24 mm about (5, −7, 9), 1 mm voxels; depth in 1/128 mm. */
const CENTRE: Vec3 = [5, -7, 9];
const RADIUS = 24;
const SIDE = 64;
const LAYOUT = {
  size: [SIDE, SIDE, SIDE] as Vec3,
  offset: 0,
  patient_from_voxel: [
    [1, 0, 0, CENTRE[0] - 32],
    [0, 1, 0, CENTRE[1] - 32],
    [0, 0, 1, CENTRE[2] - 32],
    [0, 0, 0, 1],
  ],
};

/** Values of the voxels by their place relative to the ball's centre. */
function block<V extends Int16Array<ArrayBuffer> | Uint16Array<ArrayBuffer>>(
  voxels: V,
  scale: number,
  value: (x: number, y: number, z: number) => number,
): Block<V> {
  for (let at = 0; at < voxels.length; at += 1) {
    voxels[at] = Math.round(
      value((at % SIDE) - 32, (Math.floor(at / SIDE) % SIDE) - 32, Math.floor(at / SIDE / SIDE) - 32),
    );
  }
  return { ...LAYOUT, format: voxels instanceof Int16Array ? "i16" : "u16", scale, voxels };
}

const field = block(new Int16Array(SIDE ** 3), 1 / 128, (x, y, z) => 128 * (RADIUS - Math.hypot(x, y, z)));
const depths = depthsOf(field, field);

test("the smoothed field stands in near the envelope, by degrees", () => {
  assert.deepEqual([0, 3, 4, 5, 40].map(smoothShare), [1, 1, 0.5, 0, 0]);
});

test("a ray meets the isosurface of a ball where geometry says", () => {
  for (const [x, z, depth_mm] of [
    [0, 0, 0],
    [3, -8, 4],
    [10, 5, 10],
    [-6, 2, 15.5],
  ] as const) {
    const from: Vec3 = [CENTRE[0] + x, CENTRE[1] - 60, CENTRE[2] + z];
    const hit = firstHit(depths, { from, direction: [0, 1, 0], reach_mm: 120 }, depth_mm);
    const radius = RADIUS - depth_mm;
    const expected = x * x + z * z > radius * radius ? null : CENTRE[1] - Math.sqrt(radius * radius - x * x - z * z);
    if (expected === null) assert.equal(hit, null);
    else assert.ok(hit && Math.abs(hit[1] - expected) < 0.1, `${hit} ${expected}`);
  }
});

test("a ray that passes the ball meets nothing", () => {
  const from: Vec3 = [CENTRE[0] + 25, CENTRE[1] - 60, CENTRE[2]];
  assert.equal(firstHit(depths, { from, direction: [0, 1, 0], reach_mm: 120 }, 1), null);
});

test("the shortest way into a ball is a radius, from the envelope to the centre, at equal steps of depth", () => {
  const points = wayIn(depths, [CENTRE[0] + 9, CENTRE[1] + 9, CENTRE[2]], 0.5);
  assert.ok(points.length > 2 * (RADIUS - 2) && points.length <= 2 * RADIUS + 2, String(points.length));
  for (const [step, point] of points.entries()) {
    const [x, y, z] = subtract(point, CENTRE);
    assert.ok(Math.abs(RADIUS - length([x, y, z]) - 0.5 * step) < 0.3, `${step}: ${point}`);
    if (step < 40) assert.ok(Math.abs(x - y) < 0.5 && Math.abs(z) < 0.5, String(point));
  }
});

test("a profile reads the depth at which intensity changes, here and in the mirrored point", () => {
  // Layers: 100 down to 6 mm, then 200; on the other side 100 down to 10 mm.
  const layers = block(new Uint16Array(SIDE ** 3), 2, (x, y, z) =>
    RADIUS - Math.hypot(x, y, z) < (x > 0 ? 6 : 10) ? 50 : 100,
  );
  const at = (side: number): Vec3 => [CENTRE[0] + side * 15, CENTRE[1], CENTRE[2]];
  const profile = profileAt(depths, samplerOf(layers), at(1), at(-1));
  assert.ok(profile);
  const crossing = (curve: readonly number[]): number =>
    curve.findIndex((intensity) => intensity > 150) * PROFILE_STEP_MM;
  assert.ok(Math.abs(crossing(profile.intensity) - 6) <= 0.75, String(crossing(profile.intensity)));
  assert.ok(Math.abs(crossing(profile.mirrored) - 10) <= 0.75, String(crossing(profile.mirrored)));
  assert.equal(profile.depth_mm[4], 4 * PROFILE_STEP_MM);
  assert.equal(profile.intensity[0], 100);
});

test("a place from which no way leads in has no profile", () => {
  const flat = { ...depths, depthAt: () => 0, smoothAt: () => 0, inwardAt: (): Vec3 => [0, 0, 0] };
  assert.equal(profileAt(flat, { atPatient: () => 7 }, [0, 0, 0], [0, 0, 0]), null);
});

test("outside the volume there is no intensity", () => {
  const sampler = samplerOf(field);
  assert.ok(Number.isNaN(sampler.atPatient([CENTRE[0] + 40, CENTRE[1], CENTRE[2]])));
  assert.ok(Math.abs(sampler.atPatient(CENTRE) - RADIUS) < 1e-9);
});

test("beside a cut through the brain no depth is known, nothing is picked, and a profile has a gap", () => {
  // The volume ends 12 mm to the left of the ball's centre.
  const cut = { normal: [-1, 0, 0] as const, offset_mm: -(CENTRE[0] + 12) };
  const plain: ReadyCase = { ...SHOWN, envelope_sphere: { center_in_patient: CENTRE, radius_mm: RADIUS } };
  const [whole, points] = [plain, { ...plain, cuts: [cut] }].map(
    (shown) => new Points(shown, depths, samplerOf(field)),
  ) as [Points, Points];
  const at = (x: number, y: number): Vec3 => [CENTRE[0] + x, CENTRE[1] + y, CENTRE[2]];
  // 18 mm in front of the centre the depth is 6 mm: known where the cut is 7.5 mm away or more.
  assert.ok(Math.abs(points.probe(at(0, -18)).depth_mm - 6) < 0.1);
  assert.ok(Number.isNaN(points.probe(at(7, -18)).depth_mm));
  assert.ok(Number.isFinite(whole.probe(at(7, -18)).depth_mm));
  assert.equal(points.probe(at(7, -18)).intensity, whole.probe(at(7, -18)).intensity);
  // Straight in from the front, known to 11 mm.
  const curve = points.profile(at(0, -20))?.intensity ?? [];
  assert.ok(curve.slice(0, 43).every(Number.isFinite), String(curve));
  assert.ok(curve.slice(46).every(Number.isNaN), String(curve));
  assert.ok(whole.profile(at(0, -20))?.intensity.slice(46, 80).every(Number.isFinite));
  const state = { ...firstState(plain), depth_mm: 6, orientation: NAMED_VIEWS.anterior };
  const pane = [200, 200] as const;
  const picked = (from: Points, x: number): unknown => from.pick(state, [100 + x, 100], pane);
  assert.ok(picked(points, 0));
  for (const x of [-60, 60]) assert.ok(picked(whole, x));
  assert.equal([-60, 60].filter((x) => picked(points, x) !== null).length, 1);
});

test("a point beside the head is not in it, and one outside the envelope has no profile", () => {
  const size = 61;
  const [voxel_mm, radius_mm] = [2, 40];
  const at = (index: number): number => (index - 30) * voxel_mm;
  const voxels = Float32Array.from({ length: size ** 3 }, (_, index) => {
    const place = [index % size, Math.floor(index / size) % size, Math.floor(index / size ** 2)].map(at);
    return radius_mm - Math.hypot(...place);
  });
  const field = {
    size: [size, size, size],
    voxels,
    scale: 1,
    offset: 0,
    patient_from_voxel: [
      [voxel_mm, 0, 0, -60],
      [0, voxel_mm, 0, -60],
      [0, 0, voxel_mm, -60],
      [0, 0, 0, 1],
    ],
  } as unknown as Block;
  const shown = { ...SHOWN, envelope_sphere: { center_in_patient: [0, 0, 0], radius_mm } } as const;
  const points = new Points(shown, depthsOf(field, field), samplerOf(field));
  assert.deepEqual(
    [0, 39, 50, 64, 70, 200].map((x) => points.isInHead([x, 0, 0])),
    [true, true, true, true, false, false],
  );
  assert.ok(points.profile([30, 0, 0]));
  assert.equal(points.profile([45, 0, 0]), null);
});
