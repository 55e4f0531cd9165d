import assert from "node:assert/strict";
import { test } from "node:test";

import { NAMED_VIEWS, project } from "../src/model/camera.ts";
import type { Window } from "../src/model/case.ts";
import {
  Notches,
  boundWindow,
  deepen,
  dragWindow,
  invert,
  pan,
  pinch,
  turn,
  wheelPixels,
  wheelZoom,
  zoomAt,
} from "../src/model/controls.ts";
import { BINDINGS, type Key, commandOf, keyOf } from "../src/model/keys.ts";
import { type Vec2, type Vec3, rotate } from "../src/model/space.ts";
import {
  type ViewState,
  type WindowPreset,
  firstState,
  presetWindow,
  stepDepth,
  WINDOW_PRESETS,
  windowBetween,
  windowEnds,
} from "../src/model/state.ts";
import { SHOWN } from "./shown.ts";

const FIRST = firstState(SHOWN);
const SIZE: Vec2 = [600, 400];
const near = (actual: readonly number[] | undefined, expected: readonly number[]): void => {
  assert.ok(
    actual?.length === expected.length && actual.every((value, at) => Math.abs(value - (expected[at] ?? NaN)) < 1e-6),
    `${actual} is not ${expected}`,
  );
};

test("a drag takes the near side of the head along", () => {
  const front: Vec3 = [0, 0, 1];
  const view = { ...FIRST, orientation: [0, 0, 0, 1] as const };
  const right = turn(view, [20, 0], SIZE).orientation ?? view.orientation;
  assert.ok(rotate(right, front)[0] > 0.05 && Math.abs(rotate(right, front)[1]) < 1e-9, "to the right");
  const down = turn(view, [0, 20], SIZE).orientation ?? view.orientation;
  assert.ok(rotate(down, front)[1] < -0.05 && Math.abs(rotate(down, front)[0]) < 1e-9, "down");
});

test("the trackball has no pole: a full turn over the top ends where it began, and a drag turns by its length", () => {
  let state: ViewState = { ...FIRST, orientation: NAMED_VIEWS.anterior };
  const steps = 100;
  const whole = 2 * Math.PI * 0.5 * Math.min(...SIZE);
  for (let step = 0; step < steps; step += 1) {
    const before = state.orientation;
    state = { ...state, ...turn(state, [0, whole / steps], SIZE) };
    const along = Math.abs(before.reduce((sum, part, at) => sum + part * (state.orientation[at] ?? 0), 0));
    assert.ok(Math.abs(2 * Math.acos(Math.min(along, 1)) - (2 * Math.PI) / steps) < 1e-6, `step ${step}`);
  }
  near(state.orientation, NAMED_VIEWS.anterior);
  assert.deepEqual(turn(state, [0, 0], SIZE), {});
});

test("a pan takes the head along with the hand", () => {
  const point: Vec3 = [10, 20, 30];
  const before = project(FIRST, SHOWN.envelope_sphere, SIZE).pixelOf(point);
  const after = project({ ...FIRST, ...pan(FIRST, SHOWN, [30, -12], SIZE) }, SHOWN.envelope_sphere, SIZE).pixelOf(
    point,
  );
  near([after[0] - before[0], after[1] - before[1]], [30, -12]);
});

test("a zoom keeps what is under the pointer, and stays in its range", () => {
  const place: Vec2 = [450, 90];
  const projection = project(FIRST, SHOWN.envelope_sphere, SIZE);
  const point = projection.positionOf([...place, 0]);
  const zoomed = { ...FIRST, ...zoomAt(FIRST, SHOWN, 3, place, SIZE) };
  near(project(zoomed, SHOWN.envelope_sphere, SIZE).pixelOf(point).slice(0, 2), place);
  assert.equal(zoomAt(FIRST, SHOWN, 1e9, place, SIZE).zoom, 20);
  assert.equal(zoomAt(FIRST, SHOWN, 0, place, SIZE).zoom, 0.25);
  assert.ok(wheelZoom(100) < 1 && wheelZoom(-100) > 1);
  assert.ok(Math.abs(wheelZoom(100) * wheelZoom(-100) - 1) < 1e-12);
});

test("a pinch keeps both fingers on what they touch", () => {
  const from: [Vec2, Vec2] = [
    [200, 150],
    [300, 150],
  ];
  const to: [Vec2, Vec2] = [
    [190, 200],
    [390, 200],
  ];
  const projection = project(FIRST, SHOWN.envelope_sphere, SIZE);
  const held = from.map((place) => projection.positionOf([...place, 0]));
  const state = { ...FIRST, ...pinch(FIRST, SHOWN, { from, to }, SIZE) };
  const after = project(state, SHOWN.envelope_sphere, SIZE);
  held.forEach((point, index) => near(after.pixelOf(point).slice(0, 2), to[index] ?? []));
});

test("a window drag goes the way that is preferred, and never to nothing", () => {
  const darker = dragWindow(FIRST, SHOWN, [0, -40], "up-darker").window;
  const brighter = dragWindow(FIRST, SHOWN, [0, -40], "up-brighter").window;
  assert.deepEqual([darker?.center, brighter?.center], [459.9, 340.1]);
  assert.deepEqual(dragWindow(FIRST, SHOWN, [40, 0], "up-darker").window, { center: 400, width: 659.9 });
  assert.equal(dragWindow(FIRST, SHOWN, [-1e6, 0], "up-darker").window?.width, 3);
  assert.equal(boundWindow({ center: 1e9, width: 1e9 }, SHOWN).width, 2001);
});

test("black is nowhere below the lowest intensity, however the window is dragged", () => {
  for (const move of [
    [400, 0],
    [0, -1e6],
    [1e6, -1e6],
  ] as const) {
    const { window } = dragWindow(FIRST, SHOWN, move, "up-brighter");
    assert.ok(windowEnds(window as Window)[0] >= SHOWN.intensity.min - 1e-9, `${move}: ${JSON.stringify(window)}`);
  }
});

test("depth goes in whole steps and stays in the case", () => {
  assert.equal(stepDepth(8, 1, 0.5), 8.5);
  assert.equal(stepDepth(8.3, 1, 0.5), 8.5);
  assert.equal(stepDepth(8.3, -1, 0.5), 8);
  assert.equal(stepDepth(8.3, -1, 0.1), 8.2);
  assert.equal(deepen({ ...FIRST, depth_mm: 41 }, SHOWN, 1, false).depth_mm, 41.23);
  assert.equal(deepen({ ...FIRST, depth_mm: 0.2 }, SHOWN, -1, false).depth_mm, 0);
});

test("the presets are windows of the case's own, all different", () => {
  const windows = (["auto", "full", "brain", "narrow", "bright", "dark"] as const).map((preset) =>
    presetWindow(preset, SHOWN),
  );
  assert.deepEqual(windows[0], SHOWN.intensity.window);
  assert.deepEqual(windowEnds(windows[1] as Window), [0, 1000]);
  assert.equal(new Set(windows.map(({ center, width }) => `${center},${width}`)).size, 6);
  assert.ok(windows.every(({ width }) => width >= 1));
});

test("windows of intensities from 0 to 1 are as wide as the server wants, and end where they should", () => {
  const unit = { ...SHOWN, intensity: { min: 0, max: 1, window: windowBetween(0.125, 0.5) } };
  const ends = (preset: WindowPreset): readonly number[] =>
    windowEnds(presetWindow(preset, unit)).map((end) => Number(end.toFixed(6)));
  assert.deepEqual(ends("auto"), [0.125, 0.5]);
  assert.deepEqual(ends("full"), [0, 1]);
  assert.deepEqual(ends("brain"), [0.2375, 0.5]);
  assert.deepEqual(ends("narrow"), [0.321875, 0.453125]);
  for (const preset of WINDOW_PRESETS) assert.ok(boundWindow(presetWindow(preset, unit), unit).width > 1, preset);
  const narrowed = dragWindow({ ...FIRST, window: unit.intensity.window }, unit, [-100, 0], "up-darker")
    .window as Window;
  assert.deepEqual(
    windowEnds(narrowed).map((end) => Number(end.toFixed(6))),
    [0.171875, 0.453125],
  );
});

const key = (name: string, change: Partial<Key> = {}): Key => ({
  key: name,
  code: "",
  shiftKey: false,
  altKey: false,
  ctrlKey: false,
  metaKey: false,
  ...change,
});

test("keys are commands as the help says", () => {
  assert.deepEqual(commandOf(key("[")), { kind: "depth", steps: -1, fine: false });
  assert.deepEqual(commandOf(key("}", { shiftKey: true })), { kind: "depth", steps: 1, fine: true });
  assert.deepEqual(commandOf(key("ü", { code: "BracketLeft" })), { kind: "depth", steps: -1, fine: false });
  const view = (letter: string): unknown => commandOf(key(letter, { shiftKey: true }));
  const names = ["A", "P", "L", "R", "S", "I"].map((letter) => (view(letter) as { name: string }).name);
  assert.deepEqual(names, ["anterior", "posterior", "left", "right", "superior", "inferior"]);
  assert.deepEqual(
    ["i", "r", "h", "F", " ", "Enter"].map((name) => commandOf(key(name, { shiftKey: name === "F" }))?.kind),
    ["invert", "reset", "help", "timer", "play", "mark"],
  );
  assert.deepEqual(commandOf(key("3")), { kind: "window", preset: "brain" });
  assert.equal(commandOf(key("7")), null);
  assert.deepEqual(commandOf(key("ArrowUp")), { kind: "turn", move: [0, -40] });
  assert.equal(commandOf(key("ArrowUp", { shiftKey: true }))?.kind, "pan");
});

test("every key is in the help once, and buttons know theirs", () => {
  const letters = BINDINGS.flatMap(({ keys }) => (typeof keys === "string" ? [] : keys));
  assert.equal(new Set(letters).size, letters.length);
  for (const letter of letters.filter((one) => one !== "Delete"))
    assert.ok(commandOf(key(letter, { shiftKey: letter !== letter.toLowerCase() })), letter);
  const lines = BINDINGS.map(({ help }) => help);
  assert.equal(new Set(lines).size, lines.length);
  assert.equal(
    keyOf(({ kind }) => kind === "closer"),
    "z",
  );
  assert.equal(
    keyOf((one) => one.kind === "map" && one.name === "flair"),
    "f",
  );
  assert.equal(
    keyOf(({ kind }) => kind === "recall"),
    "",
  );
});

test("the browser's own keys are left to it", () => {
  for (const change of [{ ctrlKey: true }, { metaKey: true }, { altKey: true }]) {
    for (const name of ["r", "1", "[", "ArrowLeft", "R"]) assert.equal(commandOf(key(name, change)), null);
  }
  assert.equal(commandOf(key("Tab")), null);
});

test("a touchpad's small movements add up to notches", () => {
  const notches = new Notches();
  assert.deepEqual(
    [25, 25, 25, -25, -40].map((delta) => notches.take(delta) + 0),
    [0, 0, 1, 0, -1],
    "a touchpad's movements are added up",
  );
  assert.deepEqual(
    [100, 120, 120, -53, 360, wheelPixels({ deltaX: 0, deltaY: 3, deltaMode: 1 })].map((delta) => notches.take(delta)),
    [1, 1, 1, -1, 3, 1],
    "a wheel's notch is one",
  );
  assert.equal(wheelPixels({ deltaX: -120, deltaY: 0, deltaMode: 0 }), -120, "turned sideways by the system");
});

test("inverting twice is grey again", () => {
  const once = { ...FIRST, ...invert(FIRST) };
  assert.equal(once.colormap, "inverted");
  assert.equal(invert(once).colormap, "grey");
});
