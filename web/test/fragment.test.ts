import assert from "node:assert/strict";
import { test } from "node:test";

import { NAMED_VIEWS } from "../src/model/camera.ts";
import { findingAddress, readAddress, readState, writeAddress } from "../src/model/fragment.ts";
import { type Quat, angleBetween, unit } from "../src/model/space.ts";
import { type LookNumbers, type ViewState, LOOK, LOOK_KEYS, firstState } from "../src/model/state.ts";
import { SHOWN } from "./shown.ts";

const FIRST = firstState(SHOWN);

/** What an address says of the case. */
function restOf(fragment: string): string {
  const address = readAddress(fragment);
  assert.ok(address.kind === "case" && address.id === SHOWN.id, fragment);
  return address.rest;
}

test("the first state is the case alone", () => {
  assert.equal(writeAddress(FIRST, SHOWN), `#${SHOWN.id}`);
  assert.deepEqual(readState("", SHOWN), { state: FIRST, unread: [] });
});

test("every part of a state comes back from the address, which stays short", () => {
  const state: ViewState = {
    surface: "left",
    depth_mm: 12.3,
    orientation: unit([0.1, -0.5, 0.3, 0.7]) as Quat,
    zoom: 2.125,
    pan_mm: [-12.5, 30.1],
    window: { center: 512.5, width: 99.25 },
    colormap: "viridis",
    layer: null,
    overlay: { name: "asymmetry", threshold: 3.2, opacity: 0.5 },
    beside: null,
    panes: {},
    plane: "coronal",
    swipe: { share: 0.3 },
    has_edges: true,
    averages_shallow: false,
    outlines_mm: [0, 20.5],
    ...(Object.fromEntries(LOOK_KEYS.map((key) => [key, 0.55 * LOOK[key].most])) as LookNumbers),
    way: "exact",
    layout: "mirror",
    map: { zoom: 1.75, pan_mm: [10.5, -3], has_inner: true },
    convention: "neurological",
    crosshair_mm: [-30.1, 44.2, 15],
    across_deg: -12.5,
  };
  const address = writeAddress(state, SHOWN);
  assert.ok(address.length < 256, `${address.length}`);
  const { state: back, unread } = readState(restOf(address), SHOWN);
  assert.deepEqual(unread, []);
  assert.ok(angleBetween(back.orientation, state.orientation) < 1e-3);
  assert.deepEqual({ ...back, orientation: null }, { ...state, orientation: null });
});

test("the left half comes back from the address, and is nothing without the part that says that there is one", () => {
  const layer = { id: "0123456789abcdef0123456789abcdef" };
  const overlay = { name: "blur", threshold: 3, opacity: 0.5 } as const;
  for (const beside of [
    { layer, overlay, window: { center: 20.5, width: 9.25 }, colormap: "hot" },
    { layer: null, overlay: null, window: { center: 512.5, width: 99.25 }, colormap: "grey" },
  ] as const) {
    const state: ViewState = { ...FIRST, overlay: { ...overlay, threshold: 4 }, beside };
    const rest = restOf(writeAddress(state, SHOWN));
    assert.deepEqual(readState(rest, SHOWN), { state, unread: [] });
    const alone = readState(rest.replace("t=1&", ""), SHOWN);
    assert.equal(alone.state.beside, null);
    assert.ok(alone.unread.length > 0 && alone.unread.every((part) => part.startsWith("t")), alone.unread.join());
  }
  assert.deepEqual(readState("t=1&ty=x&tw=1&tz=2", SHOWN).unread, ["ty=x", "tw=1", "tz=2"]);
});

test("the series of panes come back from the address, each with its window, and are nothing without their letters", () => {
  const layer = { id: "0123456789abcdef0123456789abcdef" };
  const overlay = { name: "blur", threshold: 3, opacity: 0.5 } as const;
  const own = { layer: null, overlay: null, window: FIRST.window, colormap: "grey" } as const;
  const state: ViewState = {
    ...FIRST,
    layer,
    window: { center: 20.5, width: 9.25 },
    plane: "axial",
    panes: {
      surface: own,
      "slice-1": { ...own, window: { center: 512.5, width: 99.25 } },
      "slice-3": { layer, overlay, window: { center: 30.5, width: 12.25 }, colormap: "hot" },
      map: { ...own, overlay },
    },
  };
  const rest = restOf(writeAddress(state, SHOWN));
  assert.deepEqual(readState(rest, SHOWN), { state, unread: [] });
  const alone = readState(rest.replace("C=1&", ""), SHOWN);
  assert.deepEqual(Object.keys(alone.state.panes), ["surface", "slice-1", "map"]);
  assert.ok(alone.unread.length === 4 && alone.unread.every((part) => part.startsWith("C")), alone.unread.join());
  assert.deepEqual(readState("A=2&Bw=1,2&n=oblique", SHOWN).unread, ["A=2", "Bw=1,2", "n=oblique"]);
});

test("a window comes back to a ten-thousandth of its ramp, however small it is", () => {
  for (const [center, width] of [
    [0.512345, 1.000987],
    [0.00051, 1.00000123],
    [12345.678, 30000.5],
  ] as const) {
    const shown = {
      ...SHOWN,
      intensity: { min: center - width + 0.5, max: center + width - 1.5, window: { center, width } },
    };
    const state = { ...FIRST, window: { center: center + (width - 1) / 7, width: 1 + 0.7 * (width - 1) } };
    const { window } = readState(restOf(writeAddress(state, shown)), shown).state;
    const near = (width - 1) / 1e4;
    assert.ok(
      Math.abs(window.center - state.window.center) <= near && Math.abs(window.width - state.window.width) <= near,
      `${window.center}, ${window.width}`,
    );
  }
});

test("a named view is written by its name", () => {
  assert.match(writeAddress({ ...FIRST, orientation: NAMED_VIEWS.superior }, SHOWN), /&v=superior$/);
});

const FIRST_AT_0 = { ...FIRST, depth_mm: 0 };

test("what is malformed or out of range is named, the rest is taken", () => {
  const malformed = [
    "d=abc",
    "d=",
    "d=Infinity",
    "q=0,0,0,0",
    "q=1,2,3",
    "q=NaN,0,0,1",
    "z=x",
    "p=1",
    "w=5,0",
    "w=5,-3",
    "w=1",
    "m=purple",
    "s=",
    "a=nil",
    "r=psychic",
    "l=round",
    "c=y",
    "x=1,2",
    "v=top",
    "=",
    "d",
    "%%%",
    "__proto__=1",
    "d=1,2",
  ];
  for (const text of malformed) assert.deepEqual(readState(text, SHOWN), { state: FIRST, unread: [text] }, text);
  const some = readState(`${malformed.join("&")}&d=3&&&`, SHOWN);
  assert.deepEqual(some, { state: { ...FIRST, depth_mm: 3 }, unread: malformed });
  const parts = ["d=1e9", "z=1e9", "p=-1e9,1e9", "s=99", "a=7", "x=1e9,0,0"];
  const { state: far, unread } = readState(parts.join("&"), SHOWN);
  assert.deepEqual([far.depth_mm, far.zoom, far.pan_mm, far.slab_mm, far.ambient], [41.23, 20, [-300, 300], 20, 1]);
  assert.equal(far.crosshair_mm, null, "a point far from the head is none");
  assert.deepEqual(unread, parts, "what was brought into its range is named as well");
  assert.deepEqual(readState("d=-4", SHOWN), { state: FIRST_AT_0, unread: ["d=-4"] });
});

test("what an address does not say is as in the state it is read upon", () => {
  const base = { ...FIRST, zoom: 3, depth_mm: 20 };
  assert.deepEqual(readState("d=5", SHOWN, base), { state: { ...base, depth_mm: 5 }, unread: [] });
});

test("an address names a case, nothing, or something that is no case", () => {
  for (const fragment of ["", "#"]) assert.deepEqual(readAddress(fragment), { kind: "none" });
  for (const fragment of [
    "#d=3",
    "#0123",
    `#${SHOWN.id.toUpperCase()}`,
    "#<script>",
    "#&&&",
    `#${SHOWN.id.slice(1)}`,
  ]) {
    assert.deepEqual(readAddress(fragment), { kind: "unknown" }, fragment);
  }
});

test("a link to a finding leads to it, and says nothing else of the view", () => {
  const link = findingAddress(SHOWN.id, "f-1");
  const of = { kind: "case", id: SHOWN.id } as const;
  assert.deepEqual(readAddress(link), { ...of, rest: "", finding: "f-1" });
  assert.deepEqual(readAddress(`#${SHOWN.id}&d=3&finding=f-1&l=map`), { ...of, rest: "d=3&l=map", finding: "f-1" });
  assert.deepEqual(readAddress(`#${SHOWN.id}&d=3`), { ...of, rest: "d=3", finding: "" });
});
