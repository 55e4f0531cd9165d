// What is saved: many pictures in one file, the profile; and which rows of a long list there are.

import assert from "node:assert/strict";
import { test } from "node:test";

import { NAMED_VIEWS } from "../src/model/camera.ts";
import { nearestSample, profileCsv } from "../src/page/profile-table.ts";
import { readDepths } from "../src/model/query.ts";
import { ROW_PIXELS, rowsInSight, scrolledTo } from "../src/model/rows.ts";
import { MOST_PICTURES, sheetBody, sweepBody, turnBody } from "../src/model/series.ts";
import { firstState } from "../src/model/state.ts";
import { wholeSweep } from "../src/model/sweep.ts";
import { SHOWN } from "./shown.ts";

const FIRST = firstState(SHOWN);
type Body = { [key: string]: unknown };

test("a contact sheet asks for each depth from each side, centred and of one size", () => {
  const turned = { ...FIRST, orientation: [0.5, 0.5, 0.5, 0.5], zoom: 3, pan_mm: [9, 9] } as const;
  const { renders, sheet } = sheetBody(turned, [5, 10], ["left", "right", "superior"], 320) as {
    renders: Body[];
    sheet: boolean;
  };
  assert.ok(sheet);
  assert.deepEqual(
    renders.map(({ depth_mm, view }) => `${String(depth_mm)} ${String(view)}`),
    ["5 left", "5 right", "5 superior", "10 left", "10 right", "10 superior"],
  );
  for (const picture of renders) {
    assert.deepEqual([picture.width, picture.height, picture.zoom, picture.pan], [320, 320, undefined, undefined]);
    assert.equal(picture.orientation, undefined);
    assert.equal(picture.annotate, true, "each names its case");
    assert.deepEqual(picture.window, [400, 600]);
  }
});

test("a turn and a sweep show what is seen, and last as long as was chosen", () => {
  const seen = { ...FIRST, orientation: NAMED_VIEWS.anterior, slab_mm: 0 };
  const { swivel } = turnBody(seen, 72, 83, [480, 320]) as { swivel: Body & { render: Body } };
  assert.deepEqual([swivel.frames, swivel.delay_ms, swivel.render.view], [72, 83, "anterior"]);
  assert.equal(swivel.render.renderer, "trace", "exact at any depth");
  const choice = { ...wholeSweep(SHOWN), from_mm: 6, to_mm: 20, mm_per_s: 5 };
  const { sweep } = sweepBody(seen, choice, 0.5, [480, 320]) as { sweep: Body & { render: Body } };
  assert.deepEqual([sweep.from_mm, sweep.to_mm, sweep.frames, sweep.delay_ms], [6, 20, 29, 100]);
  assert.deepEqual([sweep.there_and_back, sweep.average_shallow], [true, true]);
  assert.equal(sweep.render.depth_mm, undefined, "the depth is the sweep's");
  const fine = sweepBody(seen, choice, 0.01, [64, 64]) as { sweep: { frames: number } };
  assert.ok(2 * fine.sweep.frames - 2 <= MOST_PICTURES);
});

test("depths are read from a text with commas, or none is", () => {
  assert.deepEqual(readDepths("5, 10 ;15,5", 40), [5, 10, 15]);
  for (const text of ["", "5, x", "-1", "41"]) assert.equal(readDepths(text, 40), null, text);
});

test("a profile is saved with what is known of it", () => {
  const profile = { depth_mm: [0, 0.25, 0.5], intensity: [100, 110.5, NaN], mirrored: [90, NaN, 95.123456789] };
  assert.equal(
    profileCsv(profile, [], ['A "head" · 01234567', "8 mm"]),
    "depth_mm,intensity,mirrored_intensity,case,view,program\r\n" +
      ["0,100,90", "0.25,110.5,", "0.5,,95.12346"].map((row) => `${row},"A ""head"" · 01234567","8 mm"\r\n`).join(""),
  );
  const own = [
    [0, 10],
    [0.5, 20],
  ] as const;
  assert.equal(
    profileCsv(profile, [{ name: 'FLAIR, "thin"', own, mirrored: [[0.25, 7]] }], []),
    'depth_mm,intensity,mirrored_intensity,"FLAIR, ""thin""","mirrored FLAIR, ""thin""",case,view,program\r\n' +
      "0,100,90,10,7\r\n0.25,110.5,,15,7\r\n0.5,,95.12346,20,\r\n",
  );
  assert.deepEqual(
    [-3, 0.13, 0.3, 99].map((depth) => nearestSample(profile, depth)),
    [0, 1, 1, 2],
  );
});

test("of a long list the rows in sight are there, and some beyond", () => {
  assert.deepEqual(rowsInSight(1000, 0, 560), [0, 16]);
  const [first, end] = rowsInSight(1000, 500 * ROW_PIXELS, 560);
  assert.ok(first < 500 && end > 509 && end - first < 30, `${first} to ${end}`);
  assert.deepEqual(rowsInSight(3, 0, 560), [0, 3]);
  assert.deepEqual(rowsInSight(0, 900, 560), [0, 0]);
});

test("a list is scrolled no further than a row needs", () => {
  assert.equal(scrolledTo(3, 0, 560), 0);
  assert.equal(scrolledTo(20, 0, 560), 21 * ROW_PIXELS - 560);
  assert.equal(scrolledTo(2, 560, 560), 2 * ROW_PIXELS);
});
