// The list of cases: its filter in the address and in requests, and the pages of it that are asked for.

import assert from "node:assert/strict";
import { after, before, test } from "node:test";

import { type Words, speak } from "../src/base/i18n.ts";
import { readAddress } from "../src/model/fragment.ts";
import { ALL, listAddress, searchBody } from "../src/model/worklist.ts";
import { Cases } from "../src/store/cases.ts";
import english from "../src/words.en.json";

test("an address keeps the filters and the order, and never what is searched for", () => {
  const filter = { sort: "places", status: "begun", days: "7", mask: "review", has: "findings", text: "Doe" } as const;
  const address = listAddress(filter);
  assert.equal(address, "#cases&status=begun&days=7&mask=review&has=findings&sort=places");
  assert.deepEqual(readAddress(address), { kind: "list", filter: { ...filter, text: "" } });
  assert.equal(listAddress(ALL), "#cases");
  assert.deepEqual(readAddress("#cases&status=x&sort=&days=8&mask=&has=x"), { kind: "list", filter: ALL });
});

test("the server is asked for what the filter leaves", () => {
  const now = Date.UTC(2026, 10, 29, 12);
  assert.deepEqual(searchBody(ALL, now), { patients: false, sort: "newest" });
  const filter = { sort: "label", status: "new", days: "7", mask: "ok", has: "layers", text: " ab " } as const;
  const narrow = { status: "new", from: "2026-11-23", mask: "ok", has: "layers", text: "ab" };
  const conditions = { patients: false, sort: "label", ...narrow };
  assert.deepEqual(searchBody(filter, now), conditions);
  assert.deepEqual(searchBody({ ...ALL, days: "1" }, now).from, "2026-11-29");
  assert.deepEqual(searchBody({ ...ALL, status: "trash" }, now), { patients: false, sort: "newest", trashed: true });
});

const { fetch, document, window, BroadcastChannel } = globalThis;
let asked: { skip: number; sort: string; text?: string }[] = [];
before(() => {
  if (!("navigator" in globalThis)) Object.assign(globalThis, { navigator: {} });
  const page = { addEventListener: () => {}, hidden: true };
  Object.assign(globalThis, { document: page, window: globalThis, BroadcastChannel: class {} });
  globalThis.fetch = async (_input, options) => {
    const body = JSON.parse(String(options?.body)) as { skip: number; limit: number; sort: string };
    asked.push(body);
    const cases = Array.from({ length: Math.min(body.limit, 10_000 - body.skip) }, (_, at) => ({
      id: String(body.skip + at).padStart(32, "0"),
      state: "ready",
    }));
    return new Response(JSON.stringify({ cases, total: 10_000 }), { headers: { "content-type": "application/json" } });
  };
});
after(() => void Object.assign(globalThis, { fetch, document, window, BroadcastChannel }));

test("of ten thousand cases the pages in sight are asked for, and those that were scrolled past are not", async () => {
  const cases = new Cases();
  await cases.refresh();
  assert.equal(cases.total.value, 10_000);
  assert.deepEqual(
    asked.map(({ skip }) => skip),
    [0],
  );
  asked = [];
  // A hand draws the scroll bar to the end: what is in sight changes while a page is on its way.
  for (let row = 0; row < 9980; row += 20) cases.see(row, row + 20);
  cases.see(9980, 10_000);
  await cases.refresh();
  assert.equal(cases.at(9999)?.id, "9999".padStart(32, "0"));
  assert.equal(cases.at(5000), null);
  assert.ok(asked.length <= 3, JSON.stringify(asked));
  assert.equal(cases.rowOf("9990".padStart(32, "0")), 9990);
  asked = [];
  cases.choose({ sort: "label" });
  cases.see(0, 20);
  await cases.refresh();
  assert.equal(cases.at(9999), null, "what is left of another order is gone");
  assert.equal(cases.at(0)?.id, "0".padStart(32, "0"));
  assert.ok(asked.length <= 2 && asked.every(({ sort }) => sort === "label"), JSON.stringify(asked));
});

test("no list says that nothing is there or matches before the server has said so of its filter", async (context) => {
  speak("en", english as Words);
  const answer = JSON.stringify({ cases: [], total: 0 });
  const headers = { "content-type": "application/json" };
  context.mock.method(globalThis, "fetch", async () => new Response(answer, { headers }));
  const cases = new Cases();
  const said: string[] = [];
  for (const text of ["", "Doe", ""]) {
    cases.choose({ text });
    said.push(cases.note.value, String(cases.isEmpty.value));
    await cases.refresh();
    said.push(cases.note.value, String(cases.isEmpty.value));
  }
  const asking = ["Loading the cases …", "false"];
  const none = ["None yet. Add one above.", "true"];
  assert.deepEqual(said, [...asking, ...none, ...asking, "No case matches.", "false", ...asking, ...none]);
});
