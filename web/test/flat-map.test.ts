import assert from "node:assert/strict";
import { test } from "node:test";

import { panMap, zoomMap } from "../src/model/controls.ts";
import {
  FIRST_MAP,
  MAP_RIM,
  type MapPositions,
  centresOf,
  curvesOf,
  discAt,
  discsOf,
  mapExtent,
  multiples,
  pixelsPerUnit,
  placeOnMap,
  projectDisc,
  radiusAt,
  scaleAt,
  shownAt,
} from "../src/model/flat-map.ts";
import { mapQuery } from "../src/model/query.ts";
import { type Vec2, type Vec3, add, scale } from "../src/model/space.ts";
import { firstState } from "../src/model/state.ts";
import { SHOWN } from "./shown.ts";

const PLANE = { normal: [1, 0, 0], offset_mm: 0 } as const;
const CENTRES = { left: [30, 0, 0], right: [-30, 0, 0] } as const;
const SIZE: Vec2 = [700, 350];

const near = (a: readonly number[], b: readonly number[], most = 1e-9): void =>
  assert.ok(
    a.length === b.length && a.every((value, axis) => Math.abs(value - (b[axis] ?? NaN)) <= most),
    `${a.join()} is not ${b.join()}`,
  );

test("left lies on the left, anterior outwards and superior up; the inner sides lie below, anterior inwards", () => {
  const discs = discsOf(CENTRES, PLANE, true).map((disc) => projectDisc(disc, FIRST_MAP, [700, 700]));
  assert.deepEqual(
    discs.map(({ disc, center }) => [disc.hemisphere, disc.face, ...center]),
    [
      ["left", "outer", 175, 175],
      ["right", "outer", 525, 175],
      ["left", "inner", 175, 525],
      ["right", "inner", 525, 525],
    ],
  );
  for (const [at, disc] of discs.entries()) {
    const from = disc.disc.center_in_patient;
    const anterior = disc.placeOf(add(from, [0, -50, 0]));
    const outwards = at === 0 || at === 3 ? -1 : 1;
    near(anterior ?? [], [disc.center[0] + outwards * MAP_RIM * 100, disc.center[1]], 1e-6);
    near(disc.placeOf(add(from, [0, 0, 50])) ?? [], [disc.center[0], disc.center[1] - MAP_RIM * 100], 1e-6);
  }
});

test("a place comes back from its position, and lies on the disc of its hemisphere", () => {
  const discs = discsOf(CENTRES, PLANE, false).map((disc) => projectDisc(disc, { ...FIRST_MAP, zoom: 1.5 }, SIZE));
  for (const place of [
    [300, 60],
    [500, 200],
    [120, 180],
  ] as const) {
    const disc = discAt(discs, place);
    const direction = disc?.directionAt(place);
    assert.ok(disc && direction);
    const position = add(disc.disc.center_in_patient, scale(direction, 62));
    near(disc.placeOf(position) ?? [], place, 1e-9);
    if (radiusAt(disc, place) < 1) assert.deepEqual(placeOnMap(discs, PLANE, position)?.on, disc);
  }
});

test("the middles of the hemispheres are the centroids of their voxels, and those on the plane count for neither", () => {
  const size: Vec3 = [9, 5, 5];
  const voxels = new Int16Array(9 * 5 * 5).fill(-128);
  for (let z = 1; z < 4; z += 1)
    for (let y = 1; y < 4; y += 1) for (let x = 1; x < 8; x += 1) voxels[x + 9 * (y + 5 * z)] = 128;
  const patient_from_voxel = [
    [2, 0, 0, -8],
    [0, 2, 0, 10],
    [0, 0, 2, 0],
  ];
  const field = { voxels, size, patient_from_voxel, format: "i16", scale: 1, offset: 0 } as const;
  const work = centresOf(field, PLANE);
  let step = work.next();
  while (!step.done) step = work.next();
  // x from -6 to 6 mm; those at 0 lie on the plane.
  near(step.value?.left ?? [], [4, 14, 4]);
  near(step.value?.right ?? [], [-4, 14, 4]);
});

test("the place under a hand stays there when the map is zoomed", () => {
  const state = { ...firstState(SHOWN), layout: "map" } as const;
  const unit = (map = state.map): number => pixelsPerUnit(mapExtent(map), map, SIZE);
  const place: Vec2 = [500, 80];
  const shown = (map = state.map): readonly number[] => {
    const disc = discsOf(CENTRES, PLANE, false).map((one) => projectDisc(one, map, SIZE))[1];
    return disc?.directionAt(place) ?? [];
  };
  const { map } = zoomMap(state, 1.7, [place[0] - 350, place[1] - 175], unit());
  assert.equal(map.zoom, 1.7);
  near(shown(map), shown(), 1e-9);
  const moved = panMap({ map }, [12, -7], unit(map)).map;
  const [before, after] = [map, moved].map((one) => {
    const [disc] = discsOf(CENTRES, PLANE, false).map((other) => projectDisc(other, one, SIZE));
    return disc?.center ?? [0, 0];
  });
  near([(after?.[0] ?? 0) - (before?.[0] ?? 0), (after?.[1] ?? 0) - (before?.[1] ?? 0)], [12, -7], 1e-9);
});

/** A ball of 60 mm around the middle of the left hemisphere. */
function ball(): MapPositions {
  const [disc] = discsOf(CENTRES, PLANE, false).map((one) => projectDisc(one, FIRST_MAP, SIZE));
  const xyz = new Float32Array(3 * 350 * 175).fill(NaN);
  for (let row = 0; row < 175; row += 1) {
    for (let column = 0; column < 350; column += 1) {
      const direction = disc?.directionAt([2 * column + 1, 2 * row + 1]);
      if (disc && direction) xyz.set(add(disc.disc.center_in_patient, scale(direction, 60)), 3 * (row * 350 + column));
    }
  }
  return { size: [350, 175], step: 2, xyz };
}

test("on a ball the scale is its radius everywhere, and curves have their coordinate", () => {
  const positions = ball();
  // 100 pixels are a radius.
  for (const place of [
    [175, 175],
    [90, 120],
    [230, 250],
  ] as const)
    near([scaleAt(positions, place) ?? 0], [0.6], 0.002);
  assert.equal(scaleAt(positions, [500, 100]), null);
  const pieces = curvesOf(positions, 2, multiples(20)).filter(
    ([x, y]) => Math.abs((shownAt(positions, [x, y])?.[2] ?? 0) - 20) < 5,
  );
  assert.ok(pieces.length > 100);
  for (const [x, y] of pieces) {
    const shown = shownAt(positions, [x, y]);
    assert.ok(shown && Math.abs(shown[2] - 20) < 1.5, `${shown?.join()}`);
  }
});

test("the server is asked for the same map", () => {
  const state = { ...firstState(SHOWN), map: { zoom: 2, pan_mm: [3, -4.5] as const, has_inner: true } };
  const query = mapQuery(state, [800, 400]);
  assert.deepEqual(
    ["projection", "sides", "zoom", "pan", "view", "renderer", "width"].map((key) => query.get(key)),
    ["map", "both", "2", "3,-4.5", null, "trace", "800"],
  );
});
