import assert from "node:assert/strict";
import { test } from "node:test";

import {
  decodeDistance,
  decodePaths,
  decodePositions,
  decodeTriangles,
  decodeVolume,
  readLayout,
  triangleCount,
  vertexCount,
  WireError,
  pathsLength,
  summed,
} from "../src/model/wire.ts";

const MESH = { contour_count: 3, points_per_contour: 4 };

test("a mesh has 2·N_P·N_F triangles and N_P·N_F + 2 vertices", () => {
  assert.equal(triangleCount(MESH), 24);
  assert.equal(vertexCount(MESH), 14);
});

test("positions and triangles of another length are refused", () => {
  assert.equal(decodePositions(new ArrayBuffer(12 * 14), MESH).length, 42);
  assert.throws(() => decodePositions(new ArrayBuffer(12 * 14 + 4), MESH), WireError);
  assert.throws(() => decodeTriangles(new ArrayBuffer(12), MESH), WireError);
});

test("numbers are the sums of their differences, modulo 2¹⁶", () => {
  const planes = Uint8Array.of(10, 4, 1, 13, 2, 0, 0, 0, 0, 0);
  assert.deepEqual([...new Uint16Array(summed(planes))], [5, 7, 6, 65535, 0]);
  const code = 2 * (65536 - 40000) - 1;
  assert.deepEqual([...new Uint16Array(summed(Uint8Array.of(0, code & 255, 0, code >> 8)))], [0, 40000]);
});

test("triangles of vertices that there are not are refused", () => {
  const triangles = new Uint32Array(72);
  triangles[5] = 13;
  assert.equal(decodeTriangles(triangles.buffer, MESH)[5], 13);
  triangles[5] = 14;
  assert.throws(() => decodeTriangles(triangles.buffer, MESH), WireError);
});

/** Paths of two rows of 14 vertices and one piece, written as the wire README says. */
function paths(): ArrayBuffer {
  const [vertices, rows, pieces] = [14, 2, 1];
  const counts = 60 + 4 * rows + 24 * pieces + 6 * rows * vertices;
  const bytes = new ArrayBuffer(counts + 4 * rows);
  const view = new DataView(bytes);
  for (const [offset, letter] of [..."ISOP"].entries()) view.setUint8(offset, letter.charCodeAt(0));
  view.setUint16(4, 2, true);
  for (const [offset, value] of [
    [8, 3],
    [12, 4],
    [16, vertices],
    [20, rows],
    [24, pieces],
  ] as const)
    view.setUint32(offset, value, true);
  for (const [offset, value] of [
    [28, -10],
    [32, 20],
    [36, 30],
    [40, 0.5],
    [44, 0.25],
    [48, 9],
  ] as const)
    view.setFloat32(offset, value, true);
  view.setUint32(56 + 8, 1, true); // The piece follows the second row; the first two entries are 0.
  view.setUint32(60 + 8, 7, true);
  const planes = 60 + 4 * rows + 24 * pieces;
  for (let axis = 0; axis < 3; axis += 1) {
    for (let vertex = 0; vertex < vertices; vertex += 1) {
      const at = (row: number): number => planes + 2 * (axis * rows * vertices + row * vertices + vertex);
      view.setUint16(at(0), 100 * axis + vertex, true);
      view.setUint16(at(1), vertex % 2 ? 3 : 65535, true); // 3 further, or 1 back.
    }
  }
  return bytes;
}

test("the length of a table is known from its beginning", () => {
  const { byteLength } = paths();
  assert.equal(pathsLength(new DataView(paths(), 0, 56)), byteLength);
  assert.equal(pathsLength(new DataView(paths(), 0, 55)), null);
});

test("the rows of a table are the sums of their differences, modulo 2¹⁶", () => {
  const table = decodePaths(paths());
  assert.deepEqual(table.mesh, MESH);
  assert.deepEqual(table.origin_in_patient, [-10, 20, 30]);
  assert.deepEqual([table.step_mm, table.row_mm, table.row_count], [0.5, 0.25, 2]);
  assert.deepEqual([...table.first_piece], [0, 0, 1]);
  assert.equal(table.pieces[0], 7);
  const position = (row: number, vertex: number): number[] => [
    ...table.rows.subarray(4 * (14 * row + vertex), 4 * (14 * row + vertex) + 4),
  ];
  assert.deepEqual(position(0, 5), [5, 105, 205, 0]);
  assert.deepEqual(position(1, 5), [8, 108, 208, 0]);
  assert.deepEqual(position(1, 0), [65535, 99, 199, 0]);
});

test("paths are refused when they are cut, or say what cannot be", () => {
  assert.throws(() => decodePaths(paths().slice(0, 40)), WireError);
  assert.throws(() => decodePaths(paths().slice(0, -2)), WireError);
  for (const [offset, value] of [
    [0, 1],
    [4, 1],
    [4, 3],
    [16, 15],
    [20, 0],
    [20, 0xffffffff],
    [24, 0xffffffff],
    [56, 2],
    [64, 0],
  ] as const) {
    const bytes = paths();
    new DataView(bytes).setUint32(offset, value, true);
    assert.throws(() => decodePaths(bytes), WireError, `${value} at ${offset}`);
  }
});

const HEADERS = {
  "x-isocortex-size": "2,3,4",
  "x-isocortex-format": "u16",
  "x-isocortex-scale": "0.5",
  "x-isocortex-offset": "-3",
  "x-isocortex-patient-from-voxel": "1,0,0,-75,0,1,0,-77,0,0,1,-71",
};

test("a texture's headers say how to read it", () => {
  const layout = readLayout(new Headers(HEADERS));
  assert.deepEqual(layout.size, [2, 3, 4]);
  assert.deepEqual([layout.scale, layout.offset], [0.5, -3]);
  assert.deepEqual(layout.patient_from_voxel, [
    [1, 0, 0, -75],
    [0, 1, 0, -77],
    [0, 0, 1, -71],
    [0, 0, 0, 1],
  ]);
  assert.equal(decodeVolume(new ArrayBuffer(48), layout).voxels.length, 24);
  assert.throws(() => decodeVolume(new ArrayBuffer(24), layout), WireError);
  assert.throws(() => decodeDistance(new ArrayBuffer(48), layout), WireError, "depths are signed");
});

test("headers that are missing or impossible are refused", () => {
  for (const [name, value] of [
    ["x-isocortex-size", "2,3"],
    ["x-isocortex-size", "2,3,0"],
    ["x-isocortex-size", "2,3,9999"],
    ["x-isocortex-size", "2,3,1.5"],
    ["x-isocortex-format", "f32"],
    ["x-isocortex-scale", "NaN"],
    ["x-isocortex-patient-from-voxel", "1,0,0"],
  ] as const) {
    assert.throws(() => readLayout(new Headers({ ...HEADERS, [name]: value })), WireError, `${name}: ${value}`);
  }
  assert.throws(() => readLayout(new Headers()), WireError);
});
