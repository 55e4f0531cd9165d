// The one list: which finding a place has, and which row is open.

import assert from "node:assert/strict";
import test from "node:test";

import { signal } from "@preact/signals";

import type { Finding } from "../src/model/findings.ts";
import type { Candidate } from "../src/model/maps.ts";
import type { Findings } from "../src/store/findings.ts";
import type { Places } from "../src/store/places.ts";
import { Rows } from "../src/store/rows.ts";

const at = (x: number): readonly [number, number, number] => [x, 0, 0];
const place = (x: number): Candidate =>
  ({ position_in_patient: at(x), unusual: "yes", score: 3 }) as unknown as Candidate;
const finding = (id: string, from_map: string, x: number): Finding =>
  ({ id, kind: "point", from_map, points_in_patient: [at(x)] }) as unknown as Finding;
const placesOf = (map: string, x: number) => ({
  map,
  candidates: [place(x)],
  open: signal<Candidate | null>(null),
  isUnfolded: signal(false),
});

function made() {
  const [blur, flair] = [placesOf("blur", 10), placesOf("flair", 10.2)];
  const list = signal<readonly Finding[]>([]);
  const open = signal<string | null>(null);
  const findings = { list, open, sync: { keyOf: ({ id }: Finding) => id } };
  const rows = new Rows({ lists: [blur, flair] } as unknown as Places, findings as unknown as Findings);
  return { rows, list, open, blur, flair };
}

const idsOf = ({ all }: Rows): (string | undefined)[] => all.value.map((row) => row.finding?.id);

test("a place stays the row of its finding when another reader keeps the same place", () => {
  const { rows, list } = made();
  const mine = finding("mine", "blur", 10);
  list.value = [mine];
  assert.deepEqual(idsOf(rows), ["mine", undefined]);
  // The server has the other one first.
  list.value = [finding("theirs", "blur", 10), mine];
  assert.deepEqual(idsOf(rows), ["theirs", "mine", undefined]);
});

test("a place has the finding of its own map alone", () => {
  const { rows, list } = made();
  list.value = [finding("one", "flair", 10.2)];
  assert.deepEqual(idsOf(rows), [undefined, "one"]);
});

test("of two maps that list the marked place, the row that was gone to is open", () => {
  const { rows, list, open, blur, flair } = made();
  for (const one of [blur, flair]) one.open.value = one.candidates[0] ?? null;
  assert.equal(rows.open.value?.list, blur);
  rows.reached.value = rows.all.value[1]?.key ?? "";
  assert.equal(rows.open.value?.list, flair);
  list.value = [finding("plain", "", 10)];
  open.value = "plain";
  assert.equal(rows.open.value?.finding?.id, "plain");
});
