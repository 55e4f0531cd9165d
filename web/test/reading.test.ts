// The checklist and the saved layouts of a reader.

import assert from "node:assert/strict";
import { test } from "node:test";

import { NAMED_VIEWS, viewName } from "../src/model/camera.ts";
import { Checklist, bandOf, looksOf } from "../src/model/checklist.ts";
import { commandOf, recallOf } from "../src/model/keys.ts";
import { firstOverlay } from "../src/model/maps.ts";
import { type Layer, overlayOf } from "../src/model/layers.ts";
import { parsed } from "../src/model/text.ts";
import { boundName, missingOf, readLayouts, recalled, savedAs } from "../src/model/saved-layouts.ts";
import {
  type Place,
  type ViewState,
  firstState,
  halfOf,
  lookAt,
  placeOf,
  stateIn,
  withLook,
} from "../src/model/state.ts";
import { PROTOCOLS } from "../src/model/steps.ts";
import { sweptDepth } from "../src/model/sweep.ts";
import { SHOWN } from "./shown.ts";

const first = firstState(SHOWN);

test("the checklist counts the seconds for which each view was shown in each band of depths", () => {
  const list = new Checklist();
  const show = (change: Partial<ViewState> | null, seconds: number): void =>
    list.show(change && { ...first, ...change }, 1000 * seconds);
  show({ depth_mm: 5.9 }, 0);
  show({ depth_mm: 6 }, 10);
  show({ depth_mm: 12, orientation: NAMED_VIEWS.superior }, 14);
  // What is only passed by does not count, nor what nobody looks at.
  show({ depth_mm: 25 }, 20);
  show(null, 20.4);
  show({ depth_mm: 40 }, 100);
  show(null, 1000);
  assert.deepEqual(
    ([0, 6, 10, 15, 20] as const).map((band) => list.seconds("left", band)),
    [10, 4, 0, 0, 60],
  );
  assert.equal(list.seconds("superior", 10), 6);
  assert.equal(list.seconds("right", 0), 0);
  list.clear();
  assert.equal(list.seconds("left", 0), 0);
});

test("a marked place counts for its lobe and side as long as it is marked", () => {
  const list = new Checklist();
  const marked: ViewState = { ...first, depth_mm: 8, crosshair_mm: [40, 0, 10] };
  list.show(marked, 0, "temporal left");
  list.show({ ...marked, depth_mm: 12 }, 4000, "temporal left");
  list.show({ ...first, depth_mm: 12 }, 9000, "temporal left");
  list.show(null, 20_000);
  assert.deepEqual(
    ([6, 10] as const).map((band) => list.seconds("temporal left", band)),
    [4, 5],
  );
  assert.deepEqual([list.seconds("temporal right", 6), list.seconds("left", 10)], [0, 16]);
});

test("beside the mirrored half both sides are looked at, and slices and the close-up count as such", () => {
  assert.deepEqual(looksOf(first), ["left"]);
  assert.deepEqual(looksOf({ ...first, layout: "mirror" }), ["left", "right"]);
  assert.deepEqual(looksOf({ ...first, layout: "both", orientation: NAMED_VIEWS.anterior }), ["anterior", "slices"]);
  assert.deepEqual(looksOf({ ...first, layout: "closer" }), ["closer"]);
  const list = new Checklist();
  list.show({ ...first, layout: "closer", depth_mm: 8 }, 0);
  list.show({ ...first, layout: "both", depth_mm: 8 }, 3000);
  list.show(null, 8000);
  const looked = (["closer", "slices", "left", "right", "superior"] as const).map((look) => list.seconds(look, 6));
  assert.deepEqual(looked, [3, 5, 5, 5, 0]);
  assert.deepEqual([0, 5.99, 6, 19.9, 20, 50].map(bandOf), [0, 0, 6, 15, 20, 20]);
});

test("a saved layout brings back panes, depth, map and view, and holds nothing of a patient", () => {
  const state: ViewState = {
    ...first,
    layout: "both",
    depth_mm: 12,
    overlay: { ...firstOverlay("blur"), threshold: 3 },
    orientation: NAMED_VIEWS.left,
    crosshair_mm: [1.234, 5.678, 9.1],
    layer: { id: "fedcba9876543210fedcba9876543210" },
  };
  const [saved] = readLayouts(JSON.parse(JSON.stringify([savedAs(" mine ", state)])));
  assert.ok(saved);
  assert.equal(saved.name, "mine");
  assert.doesNotMatch(JSON.stringify(saved), /1\.234|fedcba|A case|01234567/);
  const back = { ...first, ...recalled(saved, first, SHOWN) };
  assert.deepEqual([back.layout, back.depth_mm, back.overlay?.name, back.overlay?.threshold], ["both", 12, "blur", 3]);
  // A map that is off switches off what is on; a case that is not so deep is shown where it ends.
  const off = savedAs("off", { ...first, depth_mm: 200 });
  assert.deepEqual([recalled(off, state, SHOWN).overlay, recalled(off, state, SHOWN).depth_mm], [null, 41.23]);
  // A layer that was added belongs to a patient.
  assert.equal(savedAs("x", { ...state, overlay: { name: "f".repeat(32), threshold: null, opacity: 1 } }).map, "");
});

test("stored layouts that are damaged are left out, and names are one plain line", () => {
  for (const text of [null, "", "null", "{}", "[1, null, {}]", '[{"name": "a", "layout": "none", "depth_mm": 1}]', "["])
    assert.deepEqual(readLayouts(parsed(text)), []);
  assert.deepEqual(readLayouts([{ name: "a", layout: "both", depth_mm: null }]), []);
  const many = Array.from({ length: 20 }, (_, at) => savedAs(`n${at}`, first));
  assert.equal(readLayouts(JSON.parse(JSON.stringify(many))).length, 9);
  assert.equal(boundName(`\u202egnp.\u0007<b>\n${"x".repeat(60)}`), `gnp. <b> ${"x".repeat(31)}`);
});

test("a saved layout has its surface and the inner sides of the map; one of before is of the whole brain", () => {
  const saved = savedAs("halves", { ...first, surface: "left", map: { ...first.map, has_inner: true } });
  const back = recalled(saved, first, SHOWN);
  assert.deepEqual([back.surface, back.map], ["left", { ...first.map, has_inner: true }]);
  const { surface, has_inner, ...before } = saved;
  const [read] = readLayouts(JSON.parse(JSON.stringify([before])));
  assert.deepEqual([read?.surface, read?.has_inner, surface, has_inner], ["whole", false, "left", true]);
});

test("a saved layout keeps what panes show by its kind, which another case has under another id", () => {
  const own = halfOf(first);
  const layer = (id: string, about: Partial<Layer>): Layer => ({
    ...{ id: id.repeat(32), name: "a name", kind: "mr", unit: "", state: "ready", window: [0, 100] },
    ...about,
  });
  const layers = [layer("1", { contrast: "flair" }), layer("2", { kind: "pet" }), layer("3", {})];
  const shows = (id: string) => ({ ...own, layer: { id: id.repeat(32) }, window: { center: 7, width: 3 } });
  const state: ViewState = {
    ...first,
    plane: "axial",
    panes: {
      across: { ...own, layer: { id: "1".repeat(32) }, overlay: firstOverlay("blur") },
      surface: { ...own, overlay: { ...firstOverlay("flair"), threshold: 3 } },
      "slice-1": own,
      "slice-2": shows("1"),
      "slice-3": shows("2"),
      map: shows("3"),
    },
  };
  const [saved] = readLayouts(JSON.parse(JSON.stringify([savedAs("sequences", state, layers)])));
  assert.ok(saved);
  // What no other case can have is one patient's.
  assert.deepEqual(saved.series, {
    surface: "flair,3",
    across: "layer:flair|blur",
    "slice-1": "own",
    "slice-2": "layer:flair",
    "slice-3": "layer:pet",
  });
  const others = [layer("4", { contrast: "flair" }), layer("5", { contrast: "flair" })];
  const { panes = {}, plane } = recalled(saved, first, SHOWN, others);
  assert.equal(plane, "axial");
  assert.deepEqual(Object.keys(panes), ["surface", "slice-1", "slice-2", "across"]);
  assert.deepEqual([panes.across?.layer?.id, panes.across?.overlay?.name], ["5".repeat(32), "blur"]);
  const coloured = savedAs("c", { ...state, panes: { map: { ...own, overlay: overlayOf(layer("2", {})) } } }, layers);
  assert.deepEqual(coloured.series, { map: "colours:pet" });
  const over = recalled(coloured, first, SHOWN, [layer("6", { kind: "pet" })]).panes?.map;
  assert.deepEqual([over?.layer, over?.overlay?.name], [null, "6".repeat(32)]);
  assert.equal(panes["slice-2"]?.layer?.id, "5".repeat(32));
  assert.deepEqual(panes["slice-2"]?.window, { center: 50.5, width: 101 });
  assert.deepEqual([panes.surface?.overlay?.name, panes.surface?.overlay?.threshold], ["flair", 3]);
  assert.deepEqual(missingOf(saved, others), ["pet"]);
  // A layout of before has none, nor has a damaged one.
  const { series: _, plane: __, ...before } = saved;
  const damaged = { ...before, series: { "slice-1": "layer:<b>", "slice-2": 3, nowhere: "own" }, plane: "oblique" };
  for (const read of readLayouts(JSON.parse(JSON.stringify([before, damaged]))))
    assert.deepEqual([read.series, read.plane], [{}, null]);
});

test("a series goes to the pane that is meant, to the left half, or to all that is shown", () => {
  const place = (change: Partial<ViewState>, asked: Place | null): Place => placeOf({ ...first, ...change }, asked);
  assert.equal(place({ layout: "slices" }, "slice-2"), "slice-2");
  assert.equal(place({ layout: "slices" }, null), "all");
  assert.equal(place({ layout: "slices" }, "map"), "all");
  assert.equal(place({ layout: "map" }, "map"), "map");
  assert.equal(place({ layout: "slices" }, "across"), "all");
  assert.equal(place({ layout: "both", across_deg: 0, crosshair_mm: [0, 0, 0] }, "across"), "across");
  // The only pane shows what all show, unless it has a series of its own.
  assert.equal(place({}, "surface"), "all");
  assert.equal(place({ panes: { surface: halfOf(first) } }, "surface"), "surface");
  assert.equal(place({ layout: "closer" }, "left"), "all");
  assert.equal(place({ layout: "closer", beside: halfOf(first) }, "left"), "left");
  const state = { ...first, ...withLook(first, "slice-3", { ...halfOf(first), colormap: "hot" }) };
  assert.deepEqual([lookAt(state, "slice-3").colormap, lookAt(state, "slice-2").colormap], ["hot", "grey"]);
  // The same object as long as nothing changes: a picture is drawn once.
  assert.equal(stateIn(state, "slice-3"), stateIn(state, "slice-3"));
  assert.equal(stateIn(state, "slice-2"), state);
});

test("the cine goes there and back between its ends, a millimetre a step", () => {
  const ends = { from_mm: -3, to_mm: 2, turns: true };
  let [at, direction]: readonly [number, number] = [0.4, 1];
  const seen = Array.from({ length: 8 }, () => ([at, direction] = sweptDepth(at, direction, ends, 1))[0]);
  assert.deepEqual(seen, [1, 2, 1, 0, -1, -2, -3, -2]);
});

test("a step shows its view whatever was marked, and what it does not say stays", () => {
  const marked: ViewState = { ...first, convention: "neurological", colormap: "bone", overlay: firstOverlay("blur") };
  const shown = PROTOCOLS.complete.map((step) => ({ ...marked, ...recalled(step, marked, SHOWN) }));
  assert.deepEqual(
    shown.map(({ layout, surface, orientation }) => [layout, surface, viewName(orientation)].join(" ")),
    [
      "single whole left",
      "single whole right",
      "single left right",
      "single right left",
      "map whole left",
      "both whole left",
      "both whole left",
      "both whole left",
    ],
  );
  for (const { depth_mm, overlay, convention, colormap } of shown)
    assert.deepEqual([depth_mm, overlay, convention, colormap], [8, null, "neurological", "bone"]);
  // One half is looked at from its outer side, or as its inner side alone.
  assert.deepEqual(shown.slice(0, 4).map(looksOf), [["left"], ["right"], [], []]);
  const depths = PROTOCOLS.depths.slice(0, 4).map((step) => recalled(step, marked, SHOWN));
  assert.deepEqual(
    depths.map(({ layout, depth_mm }) => [layout, depth_mm]),
    [6, 10, 15, 20].map((depth) => ["mirror", depth]),
  );
  for (const steps of Object.values(PROTOCOLS)) assert.equal(new Set(steps.map(({ name }) => name)).size, steps.length);
});

test("a step is ticked once it was looked at, not passed by", () => {
  const list = new Checklist();
  list.show(first, 0, null, "left 8");
  list.show(first, 900, null, "right 8");
  list.show(first, 3000);
  assert.deepEqual(
    ["left 8", "right 8", "map"].map((step) => list.hasStep(step)),
    [false, true, false],
  );
  list.clear();
  assert.equal(list.hasStep("right 8"), false);
});

test("g awaits a number; k takes the ruler; 0 goes to the next step, with shift to the one before", () => {
  const key = (text: string) => ({
    key: text,
    code: "",
    shiftKey: false,
    altKey: false,
    ctrlKey: false,
    metaKey: false,
  });
  assert.deepEqual(commandOf(key("g")), { kind: "layouts" });
  assert.deepEqual(commandOf(key("k")), { kind: "ruler" });
  assert.deepEqual(commandOf(key("0")), { kind: "step", steps: 1 });
  assert.deepEqual(commandOf({ ...key(")"), code: "Digit0", shiftKey: true }), { kind: "step", steps: -1 });
  assert.deepEqual(recallOf(key("7")), { kind: "recall", number: 7 });
  assert.equal(recallOf(key("0")), null);
  assert.equal(recallOf({ ...key("7"), ctrlKey: true }), null);
});
