import assert from "node:assert/strict";
import { test } from "node:test";

import tables from "../shaders/colors.json";
import { COLOR_NAMES, colorRow, colorTable } from "../src/gl/colors.ts";

test("colours are those of the server's tests", () => {
  assert.deepEqual(Object.keys(tables).sort(), [...COLOR_NAMES].sort());
  const table = colorTable(tables);
  const color = (name: Parameters<typeof colorRow>[0], level: number): number[] => {
    const start = 1024 * colorRow(name) + 4 * level;
    return [...table.subarray(start, start + 4)];
  };
  assert.equal(table.length, COLOR_NAMES.length * 1024);
  assert.deepEqual(color("grey", 77), [77, 77, 77, 255]);
  assert.deepEqual(color("inverted", 77), [178, 178, 178, 255]);
  assert.deepEqual(
    [0, 51, 255].map((level) => color("hot", level)),
    [
      [0, 0, 0, 255],
      [136, 0, 0, 255],
      [255, 255, 255, 255],
    ],
  );
  assert.deepEqual(
    [0, 128, 255].map((level) => color("viridis", level)),
    [
      [68, 1, 84, 255],
      [33, 145, 140, 255],
      [253, 231, 37, 255],
    ],
  );
  assert.deepEqual(color("bone", 51), [45, 45, 62, 255]);
});
