import assert from "node:assert/strict";
import { test } from "node:test";

import { transformDirection } from "../src/model/affine.ts";
import { NAMED_VIEWS } from "../src/model/camera.ts";
import { reflected, reflection } from "../src/model/midsagittal.ts";
import { lookNumbers } from "../src/model/state.ts";
import { add, normalized, scale, type Vec2, type Vec3 } from "../src/model/space.ts";
import {
  type Look,
  type Maps,
  contoursFields,
  pathsFields,
  pictureFields,
  slabOffsets,
  windowLine,
} from "../src/gl/uniforms.ts";

const grid = (side: number) => ({
  size: [50, 60, 70] as Vec3,
  patient_from_voxel: [
    [side, 0, 0, -20],
    [0, side, 0, -30],
    [0, 0, side, -40],
    [0, 0, 0, 1],
  ],
  texelScale: 1,
  texelOffset: 0,
});

/**
 * A sphere of radius 100 mm about (10, 20, 30): a picture of 200 × 100 pixels has 2 mm pixels, as in the server's
 * tests.
 */
const MAPS: Maps = {
  volume: grid(1),
  field: grid(2),
  isLayer: false,
  overlay: null,
  borderBox: [
    [3, 4, 5],
    [40, 50, 60],
  ],
  sphere: { center_in_patient: [10, 20, 30], radius_mm: 100 },
  plane: { normal: [1, 0, 0], offset_mm: 10 },
  native_spacing_mm: 1,
  cuts: [],
  spacing_mm: 2,
};
const SIZE: Vec2 = [200, 100];
const LOOK: Look = {
  surface: "whole",
  orientation: NAMED_VIEWS.anterior,
  zoom: 1,
  pan_mm: [0, 0],
  depth_mm: 8,
  window: { center: 77, width: 85 },
  ...lookNumbers("first"),
  color_row: 0,
  layer: null,
  overlay: null,
  isMirrored: false,
};

const near = (actual: readonly number[], expected: readonly number[]): void => {
  assert.equal(actual.length, expected.length);
  actual.forEach((value, at) =>
    assert.ok(Math.abs(value - (expected[at] ?? NaN)) < 1e-6, `${actual} is not ${expected}`),
  );
};

/** A position through one of the matrices. */
function through(fields: ReturnType<typeof pictureFields>, name: string, [x, y, z]: Vec3): number[] {
  const matrix = fields[name] as readonly number[];
  return [0, 1, 2].map(
    (row) => (matrix[row] ?? 0) * x + (matrix[row + 4] ?? 0) * y + (matrix[row + 8] ?? 0) * z + (matrix[row + 12] ?? 0),
  );
}

const pixelOf = (look: Look, position: Vec3): number[] => {
  const [x = 0, y = 0] = through(pictureFields(look, MAPS, SIZE), "clip_from_patient", position);
  return [100 * (x + 1), 50 * (1 - y)];
};

test("a point of the mesh lands where the server's camera puts it", () => {
  const point: Vec3 = [50, 30, 50];
  for (const [view, expected] of [
    ["left", [105, 40]],
    ["right", [95, 40]],
    ["anterior", [120, 40]],
    ["posterior", [80, 40]],
    ["superior", [80, 55]],
    ["inferior", [120, 55]],
  ] as const) {
    near(pixelOf({ ...LOOK, orientation: NAMED_VIEWS[view] }, point), expected);
  }
  near(pixelOf({ ...LOOK, zoom: 4 }, [50, 20, 50]), [180, 10]);
  near(pixelOf({ ...LOOK, zoom: 4, pan_mm: [5, 10] }, [10, 20, 30]), [110, 30]);
});

test("a line of sight starts at the same place of the patient", () => {
  const fields = pictureFields(LOOK, MAPS, SIZE);
  // Pixel (120, 40) is 40 mm to the left and 20 mm up of the centre, in voxels of 2 mm.
  const [x = 0, y = 0, z = 0] = through(fields, "field_from_frame", [120, 40, 0]);
  assert.ok(Math.hypot(x - (50 + 20) / 2, y - (20 + 30) / 2, z - (50 + 40) / 2) < 1e-9);
  near(fields.towards_viewer as readonly number[], [0, -1, 0]);
});

test("the mirrored picture shows a left mark where the plain one shows it on the right, both lit from the viewer", () => {
  const left: Vec3 = [40, 0, 35];
  const right: Vec3 = [-20, 0, 35]; // The same mirrored at x = 10.
  for (const orientation of [NAMED_VIEWS.left, NAMED_VIEWS.superior, [0.1, 0.2, 0.3, Math.sqrt(1 - 0.14)] as const]) {
    const look = { ...LOOK, orientation, zoom: 1.7, pan_mm: [3, 4] as Vec2 };
    near(pixelOf({ ...look, isMirrored: true }, left), pixelOf(look, right));
    near(pixelOf({ ...look, isMirrored: true }, right), pixelOf(look, left));
    const [plain, mirrored] = [false, true].map((isMirrored) => pictureFields({ ...look, isMirrored }, MAPS, SIZE));
    const [x = 0, y = 0, z = 0] = plain?.towards_viewer as readonly number[];
    near(mirrored?.towards_viewer as readonly number[], [-x, y, z]);
  }
});

test("at a tilted plane the mirrored picture shows a point at its mirror image, and clips nothing of the ball", () => {
  const plane = { normal: normalized([0.93, 0.3, -0.2]), offset_mm: -8 };
  const maps = { ...MAPS, plane };
  for (const orientation of [NAMED_VIEWS.left, [0.1, 0.2, 0.3, Math.sqrt(1 - 0.14)] as const]) {
    const look = { ...LOOK, orientation, zoom: 1.7, pan_mm: [3, 4] as Vec2 };
    const [plain, other] = [false, true].map((isMirrored) => pictureFields({ ...look, isMirrored }, maps, SIZE));
    assert.ok(plain && other);
    for (const point of [
      [40, 0, 35],
      [-50, 60, 12],
    ] as Vec3[]) {
      near(
        through(other, "clip_from_patient", reflected(point, plane)).slice(0, 2),
        through(plain, "clip_from_patient", point).slice(0, 2),
      );
    }
    const towards = other.towards_viewer as unknown as Vec3;
    near(towards, transformDirection(reflection(plane), plain.towards_viewer as unknown as Vec3));
    for (const side of [-1, 1]) {
      const [, , depth = NaN] = through(
        other,
        "clip_from_patient",
        add(MAPS.sphere.center_in_patient, scale(towards, side * MAPS.sphere.radius_mm)),
      );
      assert.ok(Math.abs(depth) < 1, String(depth));
    }
  }
});

test("the window is DICOM's: black at its lower end, white at its upper", () => {
  const { black, factor } = windowLine({ center: 77, width: 85 });
  assert.equal(black, 34.5);
  assert.equal((34.5 + 84 - black) * factor, 255);
});

test("a slab is sampled at most half a voxel apart, and never above the envelope", () => {
  assert.deepEqual(slabOffsets(0, 8, 1), []);
  assert.deepEqual(slabOffsets(1, 8, 1), [-1, -0.5, 0, 0.5, 1]);
  assert.deepEqual(slabOffsets(1, 0.5, 1), [-0.5, 0, 0.5, 1]);
});

test("the row before a depth is taken, the last but one at most", () => {
  const table = {
    mesh: { contour_count: 3, points_per_contour: 4 },
    origin_in_patient: [0, 0, 0] as Vec3,
    step_mm: 0.1,
    row_mm: 0.5,
    row_count: 5,
    rows: new Uint16Array(4 * 14 * 5),
    first_piece: new Uint32Array([0, 2, 2, 5, 6, 6]),
    pieces: new Uint32Array(36),
  };
  const rows = (depth_mm: number): unknown[] => {
    const { row, first_piece, piece_count, vertex_count } = pathsFields(table, depth_mm);
    return [row, first_piece, piece_count, vertex_count];
  };
  assert.deepEqual(rows(0), [0, 0, 2, 14]);
  assert.deepEqual(rows(1.2), [2, 2, 3, 14]);
  assert.deepEqual(rows(99), [3, 5, 1, 14]);
});

test("a map is sampled through its own grid, coloured between its ends; without its voxels nothing of it is drawn", () => {
  const look: Look = {
    ...LOOK,
    overlay: {
      name: "blur",
      window: [2.5, 6],
      threshold: null,
      opacity: 0.85,
      color_row: 5,
      is_diverging: true,
      is_nearest: false,
    },
  };
  const overlay = { ...grid(3), texelScale: 25.5, texelOffset: -12.8 };
  const fields = pictureFields(look, { ...MAPS, overlay }, SIZE);
  // The field has voxels of 2 mm with the same origin.
  near(through(fields, "overlay_from_field", [3, 6, 9]), [2, 4, 6]);
  assert.deepEqual(fields.overlay_size, overlay.size);
  near(
    ["scale", "offset", "low", "factor", "steepness", "opacity", "color_row", "is_diverging"].map((name) =>
      Number(fields[`overlay_${name}`]),
    ),
    [25.5, -12.8, 2.5, 255 / 3.5, 1 / 0.35, 0.85, 5, 1],
  );
  assert.equal(fields.overlay_threshold, -2e9);
  for (const [its, maps] of [
    [look, MAPS],
    [LOOK, { ...MAPS, overlay }],
  ] as const) {
    assert.equal(pictureFields(its, maps, SIZE).overlay_opacity, 0);
  }
});

test("what is nearer to a cut than the depth is behind its plane", () => {
  const without = pictureFields(LOOK, MAPS, SIZE)["cuts"] as readonly number[];
  assert.deepEqual(without, Array.from({ length: 6 }, () => [0, 0, 0, 1e9]).flat());
  // The head is cut at 12 mm, and seen at a depth of 8 mm with voxels of 2 mm: known from 12 + 8 + 3 mm on.
  const cut = { normal: [0, 0, 1] as const, offset_mm: 12 };
  const planes = pictureFields(LOOK, { ...MAPS, cuts: [cut] }, SIZE)["cuts"] as readonly number[];
  assert.equal(planes.length, 24);
  const [x, y, z, w] = planes.slice(0, 4) as [number, number, number, number];
  const along = (mm: number): number => {
    const { patient_from_voxel } = MAPS.field;
    const voxel = (mm - (patient_from_voxel[2]?.[3] ?? 0)) / (patient_from_voxel[2]?.[2] ?? 1);
    return x * 0 + y * 0 + z * voxel + w;
  };
  near([along(23), along(33)], [0, 10]);
});

test("contours are at their depths in pixels, and so are the depths of the texture", () => {
  // A picture of 200 × 100 pixels has 2 mm pixels, and the field voxels of 2 mm.
  const { levels, count, depth_px, px_per_mm, cuts_px } = contoursFields(LOOK, MAPS, SIZE, [8, 5]);
  assert.deepEqual([levels, count, depth_px], [[4, 2.5], 2, 1]);
  // The planes of the cuts are those of the look's depth of 8 mm.
  assert.deepEqual([px_per_mm, cuts_px], [0.5, 4]);
});
