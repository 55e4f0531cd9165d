// Layers: from the server's list to what is drawn, asked of the server, and kept in the address.

import assert from "node:assert/strict";
import { test } from "node:test";

import { readFileSync } from "node:fs";
import path from "node:path";

import { ICONS } from "../src/base/dom.ts";
import { boundWindow, dragWindow } from "../src/model/controls.ts";
import { commandOf } from "../src/model/keys.ts";
import { readState, writeAddress } from "../src/model/fragment.ts";
import { StateHistory } from "../src/model/history.ts";
import { type Layer, greyOf, nextOf, overlayOf, styleOfLayer } from "../src/model/layers.ts";
import { isDiverging, overlayPairs, overlayText, readOverlay, shareOf, styleOf } from "../src/model/maps.ts";
import { renderQuery, sliceQuery } from "../src/model/query.ts";
import { sheetBody } from "../src/model/series.ts";
import {
  type ViewState,
  allLayersOf,
  firstState,
  halfOf,
  namedSlots,
  presetWindow,
  textureOf,
} from "../src/model/state.ts";
import { product } from "../src/model/affine.ts";
import { subtract, transform } from "../src/model/space.ts";
import { angleOf, stepOf } from "../src/model/nudge.ts";
import { freeName, sequenceOf, sortFiles, sortLayers } from "../src/page/upload-files.ts";
import { SHOWN } from "./shown.ts";

const ID = "00112233445566778899aabbccddeeff";
const PET: Layer = {
  id: ID,
  name: "PET",
  kind: "pet",
  unit: "SUV",
  state: "ready",
  window: [0, 12],
  colormap: "hot",
  opacity: 0.6,
  range: [0, 30],
  origin: "registered",
};
const FIRST = firstState(SHOWN);

test("a layer in grey has its own window and range; labels have colours alone", () => {
  const grey = greyOf(PET);
  assert.deepEqual(grey?.intensity, { min: 0, max: 30, window: { center: 6.5, width: 13 } });
  assert.equal(greyOf({ ...PET, kind: "labels" }), null);
  const state: ViewState = { ...FIRST, layer: grey, window: grey?.intensity.window ?? FIRST.window };
  assert.deepEqual(presetWindow("auto", textureOf(state, SHOWN)), { center: 6.5, width: 13 });
  // A drag over 400 pixels changes it by the layer's width, not by the case's.
  assert.deepEqual(dragWindow(state, SHOWN, [400, 0], "up-darker").window, { center: 12.5, width: 25 });
  assert.equal(boundWindow({ center: 900, width: 13 }, textureOf(state, SHOWN)).center, 60.5);
});

test("a layer in colours is shown as the server shows it, until something else is chosen", () => {
  const overlay = overlayOf(PET);
  assert.deepEqual(overlay, { name: ID, threshold: null, opacity: 0.6 });
  const about = { ...styleOfLayer(PET), title: "PET", origin: "registered" };
  assert.deepEqual(styleOf({ ...overlay, about }).window, [0, 12]);
  assert.equal(shareOf({ ...overlay, about }, 0), 0.6);
  const other = { ...overlay, about, window: [2, 8], colormap: "blue-orange", threshold: 3 } as const;
  assert.deepEqual([styleOf(other).window, isDiverging(styleOf(other))], [[2, 8], true]);
  assert.equal(shareOf(other, -9), 0.6);
  assert.deepEqual(Object.fromEntries(overlayPairs(other)), {
    overlay: ID,
    overlay_threshold: "3",
    overlay_opacity: "0.6",
    overlay_window: "2,8",
    overlay_colormap: "blue-orange",
  });
});

test("layers come back from the address, and every picture of the server's has them", () => {
  for (const overlay of [
    overlayOf(PET),
    { name: ID, threshold: 0.0125, opacity: 0.35 },
    { name: ID, threshold: null, opacity: 1, window: [-2, 8.5] as const, colormap: "viridis" as const },
  ]) {
    assert.deepEqual(readOverlay(overlayText(overlay)), { overlay, isWhole: true }, overlayText(overlay));
    const state: ViewState = { ...FIRST, layer: { id: ID }, overlay, window: { center: 6.5, width: 13 } };
    const rest = writeAddress(state, SHOWN).split("&").slice(1).join("&");
    assert.deepEqual(readState(rest, SHOWN), { state, unread: [] }, rest);
  }
  const state: ViewState = { ...FIRST, layer: { id: ID }, window: { center: 6.5, width: 13 } };
  for (const query of [renderQuery(state, [64, 48]), sliceQuery(state, "axial", [0, 0, 0], [64, 48])])
    assert.deepEqual([query.get("layer"), query.get("window")], [ID, "6.5,13"]);
  const sheet = sheetBody({ ...state, overlay: { ...overlayOf(PET), window: [1, 2] } }, [8], ["left"], 64) as {
    renders: { layer: string; overlay_window: number[] }[];
  };
  assert.deepEqual([sheet.renders[0]?.layer, sheet.renders[0]?.overlay_window], [ID, [1, 2]]);
  assert.deepEqual(readState("y=lesion", SHOWN).unread, ["y=lesion"]);
});

test("what the server says of a layer is no step to undo", () => {
  const history = new StateHistory({ ...FIRST, layer: { id: ID } });
  history.record({ ...FIRST, layer: greyOf(PET) });
  assert.equal(history.canUndo, false);
  history.record(FIRST);
  assert.equal(history.canUndo, true);
});

test("keys go through the layers, and to none after the last", () => {
  const key = (letter: string) =>
    commandOf({ key: letter, code: "", shiftKey: false, altKey: false, ctrlKey: false, metaKey: false });
  assert.deepEqual([key("l"), key("c")], [{ kind: "grey" }, { kind: "colours" }]);
  assert.deepEqual([nextOf(["a", "b"], null), nextOf(["a", "b"], "a"), nextOf(["a", "b"], "b")], ["a", "b", null]);
  assert.equal(nextOf([], null), null);
});

const file = (name: string, size = 100): { name: string; size: number } => ({ name, size });

test("each volume is a layer, the files of DICOM together are one, and a text names labels", () => {
  const files = ["pet.nii.gz", "1.dcm", "2.dcm", "regions.nii", "regions.txt", ".DS_Store"].map((name) => file(name));
  const { volumes, labels } = sortLayers(files);
  assert.deepEqual(
    volumes.map((one) => one.map(({ name }) => name)),
    [["pet.nii.gz"], ["regions.nii"], ["1.dcm", "2.dcm"]],
  );
  assert.equal(labels?.name, "regions.txt");
});

test("of several sequences the T1 becomes the case, a mask is its mask, and the others are offered", () => {
  const sorted = (...names: string[]) => {
    const { volume, mask, layers, trouble } = sortFiles(
      names.map((name) => file(name)),
      null,
    );
    return [volume?.name ?? null, mask?.name ?? null, layers.map(({ name }) => name), trouble];
  };
  assert.deepEqual(sorted("flair.nii", "t1.nii.gz"), ["t1.nii.gz", null, ["flair.nii"], null]);
  assert.deepEqual(sorted("t2.nii", "t1.nii", "brain_mask.nii", "fdg.nii", "x.nii"), [
    "t1.nii",
    "brain_mask.nii",
    ["t2.nii", "fdg.nii", "x.nii"],
    null,
  ]);
  // As before: a volume and its mask, and what nobody can tell apart.
  assert.deepEqual(sorted("t1.nii", "t1_mask.nii"), ["t1.nii", "t1_mask.nii", [], null]);
  // Of a folder of FreeSurfer.
  assert.deepEqual(sorted("brainmask.mgz", "T1.mgz"), ["T1.mgz", "brainmask.mgz", [], null]);
  assert.deepEqual(sorted("a.nii", "b.nii", "c.nii"), [null, null, [], "upload.too-many"]);
  assert.deepEqual(sorted("t1_a.nii", "t1_b.nii", "flair.nii"), [null, null, [], "upload.too-many"]);
});

test("of a file's name only the sequence goes on, from a list; the patient's name never does", () => {
  assert.deepEqual(sequenceOf(file("Silva^Maria_FLAIR_3D.nii.gz")), { name: "FLAIR", kind: "mr" });
  assert.deepEqual(sequenceOf(file("fdg.nii")), { name: "PET", kind: "pet" });
  assert.deepEqual(sequenceOf(file("prediction.nii.gz")), { name: "labels", kind: "labels" });
  assert.deepEqual(sequenceOf(file("zmap.nii")), { name: "map", kind: "map" });
  assert.equal(sequenceOf(file("Silva^Maria.nii.gz")), null);
  assert.equal(sequenceOf(file("flair.zip")), null);
  assert.equal(freeName("FLAIR", ["FLAIR", "FLAIR 2"]), "FLAIR 3");
});

test("every icon has its shape", () => {
  const shapes = readFileSync(path.join(import.meta.dirname, "../../src/icons.svg"), "utf8");
  for (const name of ICONS) assert.ok(shapes.includes(`id="icon-${name}"`), name);
});

test("a step moves a layer by 0.5 mm or turns it by 0.5° about a point, and back", () => {
  const center = [10, -20, 30] as const;
  for (const [direction, axis, sign] of [
    [0, 0, -1],
    [1, 0, 1],
    [2, 1, -1],
    [3, 1, 1],
    [4, 2, -1],
    [5, 2, 1],
  ] as const) {
    const moved = transform(stepOf(direction, false, center), center);
    assert.deepEqual(
      moved.map((value, at) => value - (center[at] ?? 0)),
      [0, 1, 2].map((at) => (at === axis ? sign * 0.5 : 0)),
    );
    const turn = stepOf(direction, true, center);
    assert.ok(Math.hypot(...subtract(transform(turn, center), center)) < 1e-9);
    assert.ok(Math.abs(angleOf(turn) - 0.5) < 1e-6);
    assert.ok(angleOf(product(stepOf(direction ^ 1, true, center), turn)) < 1e-5);
  }
  // To the left is +x; the face, at −y, turns to the left by the last of the turns.
  const face = transform(stepOf(5, true, [0, 0, 0]), [0, -100, 0]);
  assert.ok(Math.abs(face[0] - 100 * Math.sin(Math.PI / 360)) < 1e-6 && face[0] > 0);
  const chin = transform(stepOf(0, true, [0, 0, 0]), [0, -100, 0]);
  assert.ok(chin[2] > 0.8, "the face goes up");
  const top = transform(stepOf(2, true, [0, 0, 0]), [0, 0, 100]);
  assert.ok(top[0] < -0.8, "the top of the head goes to the right");
});

test("the layers of panes count where the layout has those panes, and that of all where a pane has none of its own", () => {
  const own = (id: string) => ({ ...halfOf(FIRST), layer: { id } });
  const state: ViewState = { ...FIRST, layer: { id: "all" }, panes: { "slice-1": own("one"), map: own("map") } };
  assert.deepEqual(allLayersOf(state), ["all"]);
  assert.deepEqual(allLayersOf({ ...state, layout: "slices" }), ["all", "one"]);
  assert.deepEqual(allLayersOf({ ...state, layout: "map" }), ["all", "map"]);
  assert.deepEqual(namedSlots(state), []);
  assert.deepEqual(namedSlots({ ...state, layout: "map" }), ["surface", "map"]);
  assert.deepEqual(namedSlots({ ...state, layout: "map", beside: halfOf(FIRST) }), ["map"]);
  const alone = { ...state, panes: { surface: own("surface") } };
  assert.deepEqual(allLayersOf(alone), ["surface"]);
});
