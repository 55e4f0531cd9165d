import assert from "node:assert/strict";
import { before, test } from "node:test";

import { type Words, speak } from "../src/base/i18n.ts";
import { type Arrival, arrivalFacts, takeable } from "../src/page/arrivals.tsx";
import english from "../src/words.en.json";

before(() => speak("en", english as Words));

const ARRIVAL: Arrival = {
  id: "7",
  state: "nothing",
  first_at: "2026-11-23T10:00:00Z",
  instances: 176,
  corrected: 0,
  ignored: 0,
  refused_objects: 0,
};

test("what was refused is taken as a case or a layer, a layer as a case, and nothing else", () => {
  assert.deepEqual(takeable(ARRIVAL), ["case", "layer"]);
  assert.deepEqual(takeable({ ...ARRIVAL, instances: 0 }), []);
  assert.deepEqual(takeable({ ...ARRIVAL, state: "layer" }), ["case"]);
  assert.deepEqual(takeable({ ...ARRIVAL, state: "case" }), []);
  assert.deepEqual(takeable({ ...ARRIVAL, state: "receiving" }), []);
});

test("what is missing, superseded, not kept or refused is told, and nothing where there is nothing", () => {
  assert.deepEqual(arrivalFacts(ARRIVAL).slice(1), ["176 images"]);
  assert.deepEqual(arrivalFacts({ ...ARRIVAL, expected: 192, corrected: 3, ignored: 2 }).slice(1), [
    "176 of 192 images",
    "corrected: 3 images took the place of others",
    "2 other objects, not kept",
  ]);
  const last_refusal = "it is not an MR or CT image";
  assert.deepEqual(arrivalFacts({ ...ARRIVAL, refused_objects: 4, last_refusal }).slice(2), [
    "refused: 4, the last because it is not an MR or CT image",
  ]);
});
