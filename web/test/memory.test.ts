import assert from "node:assert/strict";
import { test } from "node:test";

import { NAMED_VIEWS } from "../src/model/camera.ts";
import { commandOf } from "../src/model/keys.ts";
import { StateHistory } from "../src/model/history.ts";
import { ViewMemory } from "../src/model/memory.ts";
import { type ViewState, firstState } from "../src/model/state.ts";
import { SHOWN } from "./shown.ts";

const FIRST = firstState(SHOWN);
const at = (depth_mm: number): ViewState => ({ ...FIRST, depth_mm });

test("changes are undone and redone in order", () => {
  const history = new StateHistory(at(8));
  history.record(at(9));
  history.record(at(10));
  assert.equal(history.undo(at(10))?.depth_mm, 9);
  assert.equal(history.undo(at(9))?.depth_mm, 8);
  assert.equal(history.undo(at(8)), null);
  assert.equal(history.redo()?.depth_mm, 9);
  assert.equal(history.redo()?.depth_mm, 10);
  assert.equal(history.redo(), null);
});

test("a change that is not recorded yet can be redone as well", () => {
  const history = new StateHistory(at(8));
  assert.equal(history.undo(at(12))?.depth_mm, 8);
  assert.equal(history.redo()?.depth_mm, 12);
});

test("a new change forgets what was undone, and the same state twice is one", () => {
  const history = new StateHistory(at(8));
  history.record(at(9));
  history.record(at(9));
  assert.equal(history.undo(at(9))?.depth_mm, 8);
  history.record(at(8));
  assert.ok(history.canRedo, "nothing has changed");
  history.record(at(20));
  assert.ok(!history.canRedo);
  assert.equal(history.undo(at(20))?.depth_mm, 8);
});

test("the time of what can be undone is known", () => {
  const history = new StateHistory(at(8));
  assert.equal(history.done_ms(at(8), 50), null);
  history.record(at(9), 100);
  history.record(at(10), 200);
  assert.deepEqual([history.done_ms(at(10), 300), history.done_ms(at(11), 300)], [200, 300]);
  history.undo(at(10));
  assert.equal(history.done_ms(at(9), 400), 100);
});

test("only so many states are remembered", () => {
  const history = new StateHistory(at(0));
  for (let step = 1; step <= 500; step += 1) history.record(at(step / 20));
  let undone = 0;
  for (let now: ViewState | null = at(25); (now = history.undo(now));) undone += 1;
  assert.equal(undone, 199);
});

test("a case is found as it was left; a new one has angle, depth and layout of the one before", () => {
  const memory = new ViewMemory();
  assert.deepEqual(memory.of(SHOWN).state, FIRST);
  const state: ViewState = {
    ...FIRST,
    depth_mm: 40,
    orientation: NAMED_VIEWS.superior,
    layout: "slices",
    zoom: 3,
    window: { center: 1, width: 2 },
    crosshair_mm: [1, 2, 3],
  };
  const history = new StateHistory(state);
  memory.keep(SHOWN, { state, history });
  assert.deepEqual(memory.of(SHOWN), { state, history });
  const other = { ...SHOWN, id: "f".repeat(32), max_depth_mm: 30 };
  const { orientation, layout } = state;
  assert.deepEqual(memory.of(other).state, { ...firstState(other), orientation, layout, depth_mm: 30 });
  assert.ok(!memory.of(other).history.canUndo, "what was done to another case is not undone here");
  memory.forget(SHOWN.id);
  assert.equal(memory.of(SHOWN).state.zoom, 1);
});

test("ctrl or command with z undoes, with shift it does again", () => {
  const key = { key: "z", code: "KeyZ", shiftKey: false, altKey: false, ctrlKey: true, metaKey: false };
  assert.deepEqual(commandOf(key), { kind: "undo" });
  assert.deepEqual(commandOf({ ...key, ctrlKey: false, metaKey: true }), { kind: "undo" });
  assert.deepEqual(commandOf({ ...key, key: "Z", shiftKey: true }), { kind: "redo" });
  assert.deepEqual(commandOf({ ...key, key: "y" }), { kind: "redo" });
  assert.equal(commandOf({ ...key, altKey: true }), null);
  assert.equal(commandOf({ ...key, key: "r" }), null);
});
