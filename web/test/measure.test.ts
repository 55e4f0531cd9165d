// The ruler against balls, boxes and triangles whose answers are known on paper.

import assert from "node:assert/strict";
import { test } from "node:test";

import { smoothed } from "../src/model/field.ts";
import { Flows, slidTo } from "../src/model/flow.ts";
import { crossesItself } from "../src/model/geodesic.ts";
import { depthsOf } from "../src/model/isosurface.ts";
import { type Measure, areCommissures, columnOf, valuesOf } from "../src/model/measure.ts";
import { type Vec3, length, normalized, scale, subtract } from "../src/model/space.ts";
import type { Block } from "../src/model/wire.ts";

const SIDE = 96;
const RADIUS = 42;
const CENTRE: Vec3 = [0, 0, 0];

/** Depth below a body of voxels of 1 mm, as the server has it: from the centres of its outermost voxels. */
function fieldOf(depth: (x: number, y: number, z: number) => number): Block<Int16Array<ArrayBuffer>> {
  const voxels = new Int16Array(SIDE ** 3);
  const place = (index: number): number => index - SIDE / 2;
  for (let at = 0; at < voxels.length; at += 1)
    voxels[at] = Math.round(
      128 * depth(place(at % SIDE), place(Math.floor(at / SIDE) % SIDE), place(Math.floor(at / SIDE / SIDE))),
    );
  return {
    size: [SIDE, SIDE, SIDE],
    offset: 0,
    patient_from_voxel: [
      [1, 0, 0, -SIDE / 2],
      [0, 1, 0, -SIDE / 2],
      [0, 0, 1, -SIDE / 2],
      [0, 0, 0, 1],
    ],
    format: "i16",
    scale: 1 / 128,
    voxels,
  };
}

function run<T>(work: Generator<void, T>): T {
  for (;;) {
    const { done, value } = work.next();
    if (done) return value;
  }
}

const field = fieldOf((x, y, z) => RADIUS - Math.hypot(x, y, z));
/** Rough, as distances to voxels are: by up to a third of a voxel. */
const rough = fieldOf(
  (x, y, z) => RADIUS - Math.hypot(x, y, z) + 0.3 * Math.sin(2.1 * x) * Math.sin(1.7 * y) * Math.sin(2.3 * z),
);
const depthsFrom = (one: typeof field) => depthsOf(one, { ...one, voxels: run(smoothed(one.voxels, one.size)) });
const depths = depthsFrom(field);

const measure = (tool: Measure["tool"], where: Measure["where"], ...points_in_patient: Vec3[]): Measure => ({
  id: "m",
  tool,
  where,
  points_in_patient,
  depth_mm: 10,
});
const within = (value: number | undefined, wanted: number, share = 0.01): void =>
  assert.ok(Math.abs(Number(value) - wanted) <= share * wanted, `${value} is not ${wanted}`);
const on = (direction: Vec3, radius: number): Vec3 => scale(normalized(direction), radius);

test("lengths, angles and areas in a slice are those of the box", () => {
  const corners: Vec3[] = [
    [0, 0, 7],
    [30, 0, 7],
    [30, 40, 7],
    [0, 40, 7],
  ];
  within(
    valuesOf(measure("length", "slice", ...[corners[0], corners[2]].map((one) => one as Vec3)), null).straight_mm,
    50,
  );
  within(valuesOf(measure("line", "slice", ...corners), null).straight_mm, 100);
  const area = valuesOf(measure("area", "slice", ...corners), null);
  within(area.area_mm2, 1200);
  within(area.straight_mm, 140);
  assert.equal(area.along_mm, undefined);
  within(valuesOf(measure("angle", "slice", ...corners.slice(0, 3)), null).angle_deg, 90);
  within(valuesOf(measure("angle", "slice", [10, 0, 0], [0, 0, 0], [10, 10, 0]), null).angle_deg, 45);
  // An area with a notch, which its middle does not see.
  const notched: Vec3[] = [...corners, [0, 30, 7], [25, 20, 7], [0, 10, 7]];
  within(valuesOf(measure("area", "slice", ...notched), null).area_mm2, 1200 - 250);
});

test("a line that crosses itself has no area, and an angle between equal points none either", () => {
  const eight: Vec3[] = [
    [0, 0, 0],
    [10, 10, 0],
    [10, 0, 0],
    [0, 10, 0],
  ];
  assert.ok(crossesItself(eight));
  const values = valuesOf(measure("area", "slice", ...eight), null);
  assert.deepEqual([values.area_mm2, values.isCrossed], [undefined, true]);
  assert.ok(!crossesItself(eight.slice(0, 3)));
  assert.ok(Number.isNaN(valuesOf(measure("angle", "slice", [1, 1, 1], [1, 1, 1], [2, 2, 2]), null).angle_deg));
  assert.ok(Number.isNaN(valuesOf(measure("angle", "slice", [1, 1, 1]), null).angle_deg));
});

for (const [name, own] of [
  ["a ball", depths],
  ["a rough ball", depthsFrom(rough)],
] as const)
  for (const depth_mm of [0, 10, 20]) {
    const surface = { depths: own, depth_mm, center: CENTRE };
    const radius = RADIUS - depth_mm;

    test(`along ${name}, ${depth_mm} mm deep, a length is an arc of a great circle`, () => {
      for (const [one, other] of [
        [
          [1, 0, 0],
          [0, 1, 0],
        ],
        [
          [1, 0.2, 0.1],
          [0.9, 0.5, 0.4],
        ],
        [
          [1, 2, 3],
          [-3, 1, 2],
        ],
        [
          [0, 0, 1],
          [0.1, -0.3, -1],
        ],
      ] as const) {
        const [a, b] = [on(one, radius), on(other, radius)];
        const arc = 2 * radius * Math.asin(length(subtract(a, b)) / (2 * radius));
        const values = valuesOf(measure("length", "surface", a, b), surface);
        within(values.along_mm, arc);
        within(values.straight_mm, length(subtract(a, b)));
      }
    });

    test(`on ${name}, ${depth_mm} mm deep, an area is that of the cap`, () => {
      const angle = 0.5;
      const rim = Array.from({ length: 48 }, (_, at): Vec3 => {
        const turn = (at / 48) * 2 * Math.PI;
        return [
          radius * Math.sin(angle) * Math.cos(turn),
          radius * Math.sin(angle) * Math.sin(turn),
          radius * Math.cos(angle),
        ];
      });
      const values = valuesOf(measure("area", "surface", ...rim), surface);
      within(values.area_mm2, 2 * Math.PI * radius * radius * (1 - Math.cos(angle)));
      within(values.along_mm, 2 * Math.PI * radius * Math.sin(angle));
    });
  }

test("opposite points have a length along the surface, and equal ones none", () => {
  const surface = { depths, depth_mm: 10, center: CENTRE };
  within(valuesOf(measure("length", "surface", [32, 0, 0], [-32, 0, 0]), surface).along_mm, Math.PI * 32);
  const none = valuesOf(measure("length", "surface", [32, 0, 0], [32, 0, 0]), surface);
  assert.ok(Number(none.along_mm) < 0.05, String(none.along_mm));
});

test("a point of a finding goes along a radius, and is where it was after twenty changes of depth", () => {
  const flows = new Flows(depths, 40);
  for (const direction of [
    [1, 0, 0],
    [1, 2, 3],
    [-2, 0.3, -1],
  ] as const) {
    const own = on(direction, RADIUS - 12.3);
    let moved = own;
    for (let change = 0; change < 20; change += 1) {
      const depth_mm = [3, 25, 0.5, 18, 12.3][change % 5] ?? 0;
      const at = flows.at(own, depth_mm);
      assert.ok(length(subtract(at, on(direction, RADIUS - depth_mm))) < 0.05, `${depth_mm}: ${at}`);
      moved = slidTo(depths, moved, depth_mm);
    }
    assert.ok(length(subtract(flows.at(own, 12.3), own)) < 0.005);
    // Also one that walks from where it has come to.
    assert.ok(length(subtract(moved, own)) < 0.05, `${moved} is not ${own}`);
  }
  assert.deepEqual(flows.at([1e6, 0, 0], 5).map(Number.isFinite), [true, true, true]);
});

for (const [name, own] of [
  ["a ball", depths],
  ["a rough ball", depthsFrom(rough)],
] as const)
  test(`the column below a cap of ${name} has the volume between two balls`, () => {
    const angle = 0.5;
    const rim = Array.from({ length: 48 }, (_, at): Vec3 => {
      const turn = (at / 48) * 2 * Math.PI;
      return on([Math.sin(angle) * Math.cos(turn), Math.sin(angle) * Math.sin(turn), Math.cos(angle)], RADIUS - 10);
    });
    const surface = { depths: own, center: CENTRE };
    const cap = measure("area", "surface", ...rim);
    for (const [from, to] of [
      [8, 12],
      [0, 20],
      [10, 11.5],
      [3, 9.7],
    ] as const) {
      const solid = 2 * Math.PI * (1 - Math.cos(angle));
      within(columnOf(cap, surface, [from, to]), (solid * ((RADIUS - from) ** 3 - (RADIUS - to) ** 3)) / 3);
    }
    assert.equal(columnOf(cap, surface, [5, 5]), 0);
    // Nothing is so deep, and depths the wrong way round have no column.
    for (const between of [[30, 60] as const, [12, 8] as const, [NaN, 3] as const])
      assert.ok(Number.isNaN(columnOf(cap, surface, between)));
  });

test("commissures are kept as far apart as the server accepts them", () => {
  assert.deepEqual([9.9, 10, 24, 45, 45.1, NaN].map(areCommissures), [false, true, true, true, false, false]);
});
