// Depths: the slider's scale, sweeps, and what is averaged near the envelope.

import assert from "node:assert/strict";
import { test } from "node:test";

import { depthOfShare, shareOfDepth, ticksTo } from "../src/model/depth-scale.ts";
import { slabOffsets } from "../src/gl/uniforms.ts";
import { renderQuery } from "../src/model/query.ts";
import { firstState, shallowMean, slabOf } from "../src/model/state.ts";
import { boundSweep, stepMs, sweptDepth, wholeSweep } from "../src/model/sweep.ts";
import { SHOWN } from "./shown.ts";

test("the slider's first half covers 0 to 25 mm, and every depth has a place of its own", () => {
  assert.equal(shareOfDepth(25, 70), 0.5);
  assert.equal(shareOfDepth(70, 70), 1);
  assert.equal(depthOfShare(0.25, 70), 12.5);
  for (const deepest of [12, 41.2, 50, 85]) {
    const places = Array.from({ length: 101 }, (_, at) => (at / 100) * deepest);
    const shares = places.map((depth) => shareOfDepth(depth, deepest));
    assert.ok(
      shares.every((share, at) => at === 0 || share > (shares[at - 1] ?? 1)),
      String(deepest),
    );
    for (const [at, depth] of places.entries())
      assert.ok(Math.abs(depthOfShare(shares[at] ?? NaN, deepest) - depth) < 1e-9);
    assert.ok(shareOfDepth(Math.min(25, deepest / 2), deepest) <= 0.5 + 1e-12);
  }
  assert.deepEqual(ticksTo(41.2), [0, 6, 10, 15, 20, 25, 40]);
});

test("a sweep turns round at both ends, or begins again", () => {
  const whole = wholeSweep(SHOWN);
  assert.deepEqual([whole.from_mm, whole.to_mm], [0, 41]);
  assert.deepEqual(sweptDepth(8, 1, whole), [8.5, 1]);
  assert.deepEqual(sweptDepth(41, 1, whole), [40.5, -1]);
  assert.deepEqual(sweptDepth(0, -1, whole), [0.5, 1]);
  const part = { ...whole, from_mm: 6, to_mm: 20, turns: false };
  assert.deepEqual(sweptDepth(20, 1, part), [6, 1]);
  assert.deepEqual(sweptDepth(30, 1, part), [20, 1], "from beside the range, its end comes first");
  assert.equal(stepMs({ ...whole, mm_per_s: 5 }), 100);
});

test("a range is brought within the case, its ends in order and apart", () => {
  const choice = { from_mm: 99, to_mm: 3, mm_per_s: 5, turns: true };
  assert.deepEqual(boundSweep(choice, SHOWN), { ...choice, from_mm: 3, to_mm: 41 });
  assert.deepEqual(boundSweep({ ...choice, from_mm: 41, to_mm: 41 }, SHOWN), { ...choice, from_mm: 40.5, to_mm: 41 });
  assert.deepEqual(boundSweep({ ...choice, from_mm: NaN, to_mm: 5 }, SHOWN), { ...choice, from_mm: 0, to_mm: 5 });
});

test("near the envelope up to a millimetre is averaged, and none of it above the envelope", () => {
  const first = firstState(SHOWN);
  const slab = (depth_mm: number): number => slabOf({ ...first, depth_mm });
  for (const [depth, mean] of [
    [0, 1],
    [0.5, 1],
    [1, 1],
    [1.5, 0.5],
    [1.9, 0.1],
  ] as const) {
    assert.ok(Math.abs(shallowMean(depth) - mean) < 1e-9, String(depth));
    const thick = depth + slab(depth) - Math.max(depth - slab(depth), 0);
    assert.ok(Math.abs(thick - mean) < 1e-9, `${depth}: ${thick}`);
    const sampled = slabOffsets(slab(depth), depth, 1).map((offset) => depth + offset);
    assert.ok(Math.min(...sampled) >= 0 && sampled.length > 1, String(sampled));
  }
  assert.equal(slab(2), 0);
  assert.equal(slab(10), 0);
  const off = { ...first, depth_mm: 0, averages_shallow: false };
  assert.equal(slabOf(off), 0);
  assert.equal(slabOf({ ...off, slab_mm: 3 }), 3);
  assert.equal(slabOf({ ...first, depth_mm: 0.5, slab_mm: 3 }), 3, "a slab that was chosen stays");
  assert.equal(renderQuery({ ...first, depth_mm: 0 }, [64, 64]).get("slab_mm"), "1");
  assert.equal(renderQuery(off, [64, 64]).get("slab_mm"), null);
});

test("the server's stand-in of a picture that may be either has no facets at any depth", () => {
  const renderer = (depth_mm: number): string | null =>
    renderQuery({ ...firstState(SHOWN), depth_mm }, [64, 64]).get("renderer");
  assert.deepEqual([10, 15, 15.5, 30].map(renderer), ["trace", "trace", "trace", "trace"]);
});
