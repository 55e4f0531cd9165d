import assert from "node:assert/strict";
import { test } from "node:test";

import { project } from "../src/model/camera.ts";
import type { ReadyCase } from "../src/model/case.ts";
import { linked } from "../src/model/linked.ts";
import { type Affine, type Vec3, compose, inverted, rotate, transform, turnAbout, unit } from "../src/model/space.ts";
import { firstState } from "../src/model/state.ts";
import { SHOWN } from "./shown.ts";

const TURN = turnAbout([1, 2, 3], 0.4);
const SHIFT: Vec3 = [12, -7, 5];

/** From the patient space of the second case to that of the first. */
const first_from_second: Affine = [
  ...[0, 1, 2].map((row) => [
    ...(
      [
        [1, 0, 0],
        [0, 1, 0],
        [0, 0, 1],
      ] as const
    ).map((axis) => rotate(TURN, axis)[row as 0 | 1 | 2]),
    SHIFT[row as 0 | 1 | 2],
  ]),
  [0, 0, 0, 1],
];

const SECOND: ReadyCase = {
  ...SHOWN,
  envelope_sphere: { center_in_patient: [-4, 9, 2], radius_mm: 90 },
  max_depth_mm: 30,
  intensity: { min: 0, max: 4000, window: { center: 1000, width: 2000 } },
};

const SIZE = [640, 480] as const;
const orientation = unit(compose(turnAbout([3, 1, -2], 1), [0.5, 0.5, 0.5, 0.5])) ?? [0, 0, 0, 1];
const one = {
  shown: SHOWN,
  state: { ...firstState(SHOWN), orientation, zoom: 1.7, pan_mm: [11, -6] as const, depth_mm: 12.5 },
};
const other = { shown: SECOND, state: firstState(SECOND) };

test("the same place of two heads is seen at the same place of a pane, as large, from the same side", () => {
  const its = { ...other.state, ...linked(one, other, first_from_second) };
  for (const place of [
    [0, 0, 0],
    [30, -20, 15],
    [-8, 44, -31],
  ] as const) {
    const [x, y, z] = project(one.state, SHOWN.envelope_sphere, SIZE).pixelOf(transform(first_from_second, place));
    const [itsX, itsY, itsZ] = project(its, SECOND.envelope_sphere, SIZE).pixelOf(place);
    assert.ok(Math.abs(x - itsX) < 1e-6 && Math.abs(y - itsY) < 1e-6, `${[x, y]} ${[itsX, itsY]}`);
    // Towards the viewer each head has its own middle.
    const [, , middle] = project(one.state, SHOWN.envelope_sphere, SIZE).pixelOf(
      transform(first_from_second, SECOND.envelope_sphere.center_in_patient),
    );
    assert.ok(Math.abs(z - middle - itsZ) < 1e-6);
  }
});

test("a point, a depth and a window are taken over, and come back as they were", () => {
  const state = { ...one.state, crosshair_mm: [20, -30, 40] as Vec3, window: { center: 77, width: 31 } };
  const its = linked({ ...one, state }, other, first_from_second);
  const expected = transform(inverted(first_from_second) ?? [], state.crosshair_mm);
  assert.deepEqual(its.crosshair_mm, expected);
  assert.equal(its.depth_mm, 12.5);
  const back = linked(
    { ...other, state: { ...other.state, ...its } },
    { ...one, state },
    inverted(first_from_second) ?? [],
  );
  assert.ok(back.crosshair_mm?.every((part, axis) => Math.abs(part - (state.crosshair_mm[axis] ?? 0)) < 1e-9));
  for (const key of ["center", "width"] as const)
    assert.ok(Math.abs((back.window?.[key] ?? 0) - state.window[key]) < 1e-9, key);
  assert.ok(back.orientation.every((part, at) => Math.abs(part - (orientation[at] ?? 0)) < 1e-9));
  assert.ok(back.pan_mm.every((part, at) => Math.abs(part - (state.pan_mm[at] ?? 0)) < 1e-9));
  assert.ok(Math.abs(back.zoom - state.zoom) < 1e-9);
});

test("a depth that the other head does not have is its deepest; the window of a layer is not taken over", () => {
  const deep = { ...one, state: { ...one.state, depth_mm: 55 } };
  assert.equal(linked(deep, other, first_from_second).depth_mm, 30);
  const layered = { ...one, state: { ...one.state, layer: { id: "f".repeat(32) } } };
  assert.equal(linked(layered, other, first_from_second).window, undefined);
  assert.equal(linked(one, other, first_from_second).crosshair_mm, null);
});
