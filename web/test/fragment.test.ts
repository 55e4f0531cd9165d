import assert from "node:assert/strict";
import { test } from "node:test";

import { NAMED_VIEWS } from "../src/model/camera.ts";
import { readAddress, readState, writeAddress } from "../src/model/fragment.ts";
import { type Quat, angleBetween, unit } from "../src/model/space.ts";
import { type ViewState, firstState } from "../src/model/state.ts";
import { SHOWN } from "./shown.ts";

const FIRST = firstState(SHOWN);

test("the first state is the case alone", () => {
  assert.equal(writeAddress(FIRST, SHOWN), `#${SHOWN.id}`);
  assert.deepEqual(readState("", SHOWN), FIRST);
});

test("every part of a state comes back from the address, which stays short", () => {
  const state: ViewState = {
    depth_mm: 12.3,
    orientation: unit([0.1, -0.5, 0.3, 0.7]) as Quat,
    zoom: 2.125,
    pan_mm: [-12.5, 30.1],
    window: { center: 512.5, width: 99.25 },
    colormap: "viridis",
    slab_mm: 1.5,
    ambient: 0.55,
    way: "exact",
    layout: "mirror",
    convention: "neurological",
    crosshair_mm: [-30.1, 44.2, 15],
  };
  const address = writeAddress(state, SHOWN);
  assert.ok(address.length < 200, `${address.length}`);
  const { id, rest } = readAddress(address);
  assert.equal(id, SHOWN.id);
  const back = readState(rest, SHOWN);
  assert.ok(angleBetween(back.orientation, state.orientation) < 1e-3);
  assert.deepEqual({ ...back, orientation: null }, { ...state, orientation: null });
});

test("a window comes back to a ten-thousandth of its ramp, however small it is", () => {
  for (const [center, width] of [
    [0.512345, 1.000987],
    [0.00051, 1.00000123],
    [12345.678, 30000.5],
  ] as const) {
    const shown = {
      ...SHOWN,
      intensity: { min: center - width + 1, max: center + width - 1, window: { center, width } },
    };
    const state = { ...FIRST, window: { center: center + (width - 1) / 7, width: 1 + 0.7 * (width - 1) } };
    const { window } = readState(readAddress(writeAddress(state, shown)).rest, shown);
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

test("what is malformed or out of range is passed over, the rest is taken", () => {
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
    "&&&",
    "=",
    "d",
    "%%%",
    "__proto__=1",
    "d=1,2",
  ];
  for (const text of malformed) assert.deepEqual(readState(text, SHOWN), FIRST, text);
  assert.deepEqual(readState(`${malformed.join("&")}&d=3`, SHOWN), { ...FIRST, depth_mm: 3 });
  const far = readState("d=1e9&z=1e9&p=-1e9,1e9&s=99&a=7", SHOWN);
  assert.deepEqual([far.depth_mm, far.zoom, far.pan_mm, far.slab_mm, far.ambient], [41.23, 20, [-300, 300], 20, 1]);
  assert.equal(readState("x=1e9,0,0", SHOWN).crosshair_mm, null, "a point far from the head is none");
  assert.equal(readState("d=-4", SHOWN).depth_mm, 0);
});

test("an address without a case's id names none", () => {
  for (const fragment of ["", "#", "#d=3", "#0123", `#${SHOWN.id.toUpperCase()}`, "#<script>"]) {
    assert.equal(readAddress(fragment).id, null, fragment);
  }
});
