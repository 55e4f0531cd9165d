import assert from "node:assert/strict";
import { test } from "node:test";

import { NAMED_VIEWS, VIEW_NAMES, edgesOf, facing, mirrored, project, viewName } from "../src/model/camera.ts";
import { plainPlane, reflected, reflection } from "../src/model/midsagittal.ts";
import {
  type Quat,
  type Vec3,
  angleBetween,
  compose,
  inverted,
  normalized,
  rotate,
  transform,
  turnAbout,
  unit,
} from "../src/model/space.ts";

const SPHERE = { center_in_patient: [10, 20, 30], radius_mm: 100 } as const;

const near = (actual: readonly number[], expected: readonly number[]): void => {
  assert.equal(actual.length, expected.length);
  actual.forEach((value, index) =>
    assert.ok(Math.abs(value - (expected[index] ?? NaN)) < 1e-9, `${actual} is not ${expected}`),
  );
};

test("a point lands where the server's camera puts it", () => {
  // The same numbers as in the server's test of its camera.
  const point: Vec3 = [50, 30, 50];
  const expected: Record<string, Vec3> = {
    left: [105, 40, 40],
    right: [95, 40, -40],
    anterior: [120, 40, -10],
    posterior: [80, 40, 10],
    superior: [80, 55, 20],
    inferior: [120, 55, -20],
  };
  for (const name of VIEW_NAMES) {
    const projection = project({ orientation: NAMED_VIEWS[name], zoom: 1, pan_mm: [0, 0] }, SPHERE, [200, 100]);
    const pixel = projection.pixelOf(point);
    near(pixel, expected[name] ?? []);
    near(projection.positionOf(pixel), point);
  }
});

test("zoom enlarges about the centre and pan moves right and up", () => {
  const orientation = NAMED_VIEWS.anterior;
  near(project({ orientation, zoom: 4, pan_mm: [0, 0] }, SPHERE, [200, 100]).pixelOf([50, 20, 50]), [180, 10, 0]);
  near(project({ orientation, zoom: 4, pan_mm: [5, 10] }, SPHERE, [200, 100]).pixelOf([10, 20, 30]), [110, 30, 0]);
});

test("a view is known by its name, also when the quaternion's sign is turned", () => {
  for (const name of VIEW_NAMES) {
    const [x, y, z, w] = NAMED_VIEWS[name];
    assert.equal(viewName([x, y, z, w]), name);
    assert.equal(viewName([-x, -y, -z, -w]), name);
  }
  assert.equal(viewName(compose(turnAbout([0, 1, 0], 0.01), NAMED_VIEWS.left)), null);
});

test("letters at the edges are those of the view", () => {
  const words = (name: (typeof VIEW_NAMES)[number]): string => Object.values(edgesOf(NAMED_VIEWS[name])).join("");
  assert.deepEqual(VIEW_NAMES.map(words), ["APSI", "PASI", "RLSI", "LRSI", "LRAP", "RLAP"]);
  const oblique = compose(turnAbout([0, 1, 0], Math.PI / 4), NAMED_VIEWS.anterior);
  assert.equal(edgesOf(oblique).left.length, 2);
});

test("a direction is turned to the viewer with the head upright", () => {
  for (const outward of [
    [1, 0, 0],
    [0.3, -0.8, 0.2],
    [0, 0, 1],
    [0.01, 0, -1],
  ] as Vec3[]) {
    const size = Math.hypot(...outward);
    near(rotate(facing(outward), outward), [0, 0, size]);
  }
  assert.equal(viewName(facing([1, 0, 0])), "left");
  assert.equal(viewName(facing([0, 0, 1])), "superior");
});

const PLAIN = plainPlane(SPHERE);
/** Tilted by some 20°, and beside the sphere's centre. */
const TILTED = { normal: normalized([0.93, 0.3, -0.2]), offset_mm: 3 } as const;
const VIEW = { orientation: unit([0.2, -0.4, 0.5, 0.7]) as Quat, zoom: 1.7, pan_mm: [12, -7] } as const;

test("the mirrored view, flipped, puts the mirrored point where the view puts the point", () => {
  const size = [300, 200] as const;
  for (const plane of [PLAIN, TILTED]) {
    for (const point of [
      [60, -5, 44],
      [-33, 41, 2],
    ] as Vec3[]) {
      const [x, y] = project(VIEW, SPHERE, size).pixelOf(point);
      const [other_x, other_y] = project(mirrored(VIEW, plane, SPHERE), SPHERE, size).pixelOf(reflected(point, plane));
      near([300 - other_x, other_y], [x, y]);
    }
  }
});

test("at the plain plane the mirrored view is turned, panned the other way, and right where the view is left", () => {
  const {
    orientation: [x, y, z, w],
    zoom,
    pan_mm: [right, up],
  } = VIEW;
  const other = mirrored(VIEW, PLAIN, SPHERE);
  near([...other.orientation, other.zoom, ...other.pan_mm], [x, -y, -z, w, zoom, -right, up]);
  for (const [name, opposite] of [
    ["left", "right"],
    ["right", "left"],
    ["anterior", "anterior"],
    ["superior", "superior"],
  ] as const) {
    assert.equal(viewName(mirrored({ ...VIEW, orientation: NAMED_VIEWS[name] }, PLAIN, SPHERE).orientation), opposite);
  }
});

test("a view mirrored twice is itself", () => {
  const back = mirrored(mirrored(VIEW, TILTED, SPHERE), TILTED, SPHERE);
  assert.ok(angleBetween(back.orientation, VIEW.orientation) < 1e-7);
  near([back.zoom, ...back.pan_mm], [VIEW.zoom, ...VIEW.pan_mm]);
});

test("a point reflected twice is itself, one on the plane stays, and the affine does the same", () => {
  const point: Vec3 = [60, -5, 44];
  const other = reflected(point, TILTED);
  near(reflected(other, TILTED), point);
  near(transform(reflection(TILTED), point), other);
  const middle: Vec3 = [(point[0] + other[0]) / 2, (point[1] + other[1]) / 2, (point[2] + other[2]) / 2];
  near(reflected(middle, TILTED), middle);
  near(reflected(point, PLAIN), [-40, -5, 44]);
});

test("an affine and its inverse cancel, and a flat one has none", () => {
  const affine = [
    [0, -2, 0, 5],
    [0.5, 0, 0, 7],
    [0, 0, 3, -9],
    [0, 0, 0, 1],
  ];
  const back = inverted(affine);
  assert.ok(back);
  near(transform(back, transform(affine, [1, 2, 3])), [1, 2, 3]);
  assert.equal(
    inverted([
      [1, 0, 0, 0],
      [2, 0, 0, 0],
      [0, 0, 1, 0],
      [0, 0, 0, 1],
    ]),
    null,
  );
});
