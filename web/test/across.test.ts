// The plane across a sulcus, as the server states it and as hands turn it.

import assert from "node:assert/strict";
import { test } from "node:test";

import {
  type AcrossPlane,
  awayFrom,
  boundTurn,
  hasSides,
  normalOf,
  readPlane,
  traceOf,
  turnTo,
  turnedPlane,
} from "../src/model/across.ts";
import { commandOf } from "../src/model/keys.ts";
import { NAMED_VIEWS } from "../src/model/camera.ts";
import { readState, writeAddress } from "../src/model/fragment.ts";
import { acrossQuery } from "../src/model/query.ts";
import { type Vec3, cross, dot, fromRows, normalized } from "../src/model/space.ts";
import { firstState } from "../src/model/state.ts";
import { SHOWN } from "./shown.ts";

/** A coronal plane at the patient's left, where the normal of the surface is to the left. */
const coronal: AcrossPlane = {
  mark: [40, 0, 10],
  turn_deg: 0,
  orientation: NAMED_VIEWS.anterior,
  turned_about: [1, 0, 0],
  angles: "cor",
};
const near = (one: Vec3 | null, other: Vec3): void =>
  assert.ok(one && Math.abs(Math.abs(dot(one, normalized(other))) - 1) < 1e-9, `${one} is not along ${other}`);

test("a plane that is turned holds the normal of the surface, and its trace turns with it", () => {
  near(normalOf(coronal), [0, 1, 0]);
  const turned = turnedPlane(coronal, 30);
  near(normalOf(turned), [0, Math.cos(Math.PI / 6), Math.sin(Math.PI / 6)]);
  assert.ok(Math.abs(dot(normalOf(turned), coronal.turned_about)) < 1e-9);
  near(traceOf(coronal, 2), [1, 0, 0]);
  near(traceOf(coronal, 0), [0, 0, 1]);
  near(traceOf(turned, 0), [0, -Math.sin(Math.PI / 6), Math.cos(Math.PI / 6)]);
  // A plane that lies in a slice does not cross it.
  assert.equal(traceOf(coronal, 1), null);
  assert.ok(Math.abs(awayFrom(turned, [47, 0, 10])) < 1e-9);
  assert.ok(Math.abs(awayFrom(coronal, [40, 5, 10])) - 5 < 1e-9);
});

test("a handle that is dragged along a trace of another turn brings the plane there", () => {
  const about = normalized([3, -1, 2]);
  const normal = normalized(cross(about, [0, 0, 1]));
  const oblique: AcrossPlane = {
    ...coronal,
    turned_about: about,
    orientation: fromRows(about, cross(normal, about), normal),
  };
  for (const plane of [coronal, oblique])
    for (const turn_deg of [-89, -40, 0, 25, 90]) {
      const wanted = turnedPlane(plane, turn_deg);
      for (const axis of [0, 1, 2] as const) {
        const along = traceOf(wanted, axis);
        const found = along && turnTo(plane, along);
        // Where the line is the one about which the plane turns, it says nothing.
        if (found !== null) assert.ok(Math.abs(Math.sin(((found - turn_deg) * Math.PI) / 180)) < 0.002, `${found}`);
      }
    }
  assert.equal(turnTo(coronal, [1, 0, 0]), null);
  // Also from a plane that is turned already, and in both directions of the line.
  for (const direction of [[0, 1, 1] as const, [0, -1, -1] as const])
    assert.equal(turnTo(turnedPlane(coronal, 30), direction), -45);
});

test("turns are of half a circle, and what the server says is read or left", () => {
  assert.deepEqual([0, 45, 90, 95, -95, 179, 1000].map(boundTurn), [0, 45, -90, -85, 85, -1, -80]);
  const text = '{"orientation":[0,0,0,2],"turned_about":[3,0,0],"angles":"ax"}';
  assert.deepEqual(readPlane(text), { orientation: [0, 0, 0, 1], turned_about: [1, 0, 0], angles: "ax" });
  for (const wrong of [
    null,
    "",
    "null",
    "{",
    "[]",
    '{"orientation":[0,0,0,1],"angles":"ax"}',
    text.replace("3", '"x"'),
  ])
    assert.equal(readPlane(wrong), null);
  assert.ok(hasSides(coronal));
  assert.ok(!hasSides({ ...coronal, orientation: NAMED_VIEWS.left }));
});

test("the slice across the sulcus is in the address, and asks as the other slices do", () => {
  const state = { ...firstState(SHOWN), crosshair_mm: [1.25, 2, 3] as const, across_deg: -32.5 };
  const [, rest = ""] = /^#[0-9a-f]+&(.*)$/.exec(writeAddress(state, SHOWN)) ?? [];
  assert.equal(readState(rest, SHOWN).state.across_deg, -32.5);
  assert.equal(readState("", SHOWN).state.across_deg, null);
  assert.deepEqual(readState("u=500", SHOWN).unread, ["u=500"]);
  const query = acrossQuery({ ...state, convention: "neurological" }, [[1.25, 2, 3], -32.5], [64, 48]);
  assert.deepEqual(
    ["position", "turn_deg", "convention", "depth_mm", "width"].map((key) => query.get(key)),
    ["1.25,2,3", "-32.5", "neurological", "10", "64"],
  );
  const key = { key: "x", code: "KeyX", shiftKey: false, altKey: false, ctrlKey: false, metaKey: false };
  assert.deepEqual(commandOf(key), { kind: "across" });
});
