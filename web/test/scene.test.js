import assert from "node:assert/strict";
import { test } from "node:test";

import { VIEWS, caseStatus, clampDepth, deepest, pictureSize, renderQuery, sliceRange } from "../src/scene.js";

const ready = {
  max_depth_mm: 41.3,
  intensity: { min: 0, max: 200, window: { center: 90, width: 120 } },
  grid: { size: [11, 21, 31], patient_from_voxel: [[-1, 0, 0, 5], [0, -2, 0, 20], [0, 0, 0.5, -7.2], [0, 0, 0, 1]] },
};

test("opposite views mirror left and right and keep up and down", () => {
  for (const [one, other] of [["left", "right"], ["anterior", "posterior"]]) {
    assert.equal(VIEWS[one].edges.left, VIEWS[other].edges.right);
    assert.equal(VIEWS[one].edges.right, VIEWS[other].edges.left);
    assert.equal(VIEWS[one].edges.top, VIEWS[other].edges.top);
  }
  assert.equal(VIEWS.superior.edges.left, "L");
  assert.equal(VIEWS.inferior.edges.left, "R");
});

test("seen from in front, the patient's left is at the picture's right", () => {
  assert.equal(VIEWS.anterior.edges.right, "L");
});

test("every view shows two opposite pairs of directions", () => {
  const opposite = { L: "R", R: "L", A: "P", P: "A", S: "I", I: "S" };
  for (const { edges } of Object.values(VIEWS)) {
    assert.equal(opposite[edges.left], edges.right);
    assert.equal(opposite[edges.top], edges.bottom);
  }
});

test("a depth is put on the steps and kept within the case", () => {
  assert.equal(deepest(ready), 41);
  assert.equal(clampDepth(8.2, ready), 8);
  assert.equal(clampDepth(8.3, ready), 8.5);
  assert.equal(clampDepth(-1, ready), 0);
  assert.equal(clampDepth(Infinity, ready), 41);
  assert.equal(clampDepth(-Infinity, ready), 0);
  assert.equal(clampDepth(NaN, ready), 0);
});

test("a plane moves over the extent of the grid whichever way the axis runs", () => {
  assert.deepEqual(sliceRange(ready.grid, "sagittal"), { min: -5, max: 5, middle: 0 });
  assert.deepEqual(sliceRange(ready.grid, "coronal"), { min: -20, max: 20, middle: 0 });
  const axial = sliceRange(ready.grid, "axial");
  assert.deepEqual([axial.min, axial.max], [-7, 7.5]);
  assert.ok(axial.middle >= axial.min && axial.middle <= axial.max);
});

test("a render's query names only what differs from the defaults, besides the window", () => {
  const scene = { depth_mm: 8, zoom: 1, window: { center: 90, width: 120 }, colormap: "grey" };
  assert.equal(renderQuery(scene, "left", 512), "depth_mm=8&view=left&window=90%2C120&width=512&height=512");
  assert.match(renderQuery({ ...scene, zoom: 2, colormap: "hot" }, "left", 512), /zoom=2.*colormap=hot/);
});

test("pictures come in few sizes and never beyond 1024 pixels", () => {
  assert.equal(pictureSize(500, 1), 512);
  assert.equal(pictureSize(513, 1), 640);
  assert.equal(pictureSize(900, 2), 1024);
  assert.equal(pictureSize(0, 1), 128);
});

test("a case's state is said in words", () => {
  assert.equal(caseStatus({ state: "preparing", progress: { stage: "forest", fraction: 0.421 } }), "growing the forest · 42 %");
  assert.equal(caseStatus({ state: "ready", max_depth_mm: 41.27 }), "ready · 41.3 mm deep");
  assert.equal(caseStatus({ state: "failed", error: { detail: "the mask is empty" } }), "The mask is empty.");
});
