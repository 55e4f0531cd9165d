// The readings of two readers side by side, and how a conclusion comes to the server and is signed.

import assert from "node:assert/strict";
import { afterEach, beforeEach, mock, test } from "node:test";

import { signal } from "@preact/signals";

import { type Finding, newFinding } from "../src/model/findings.ts";
import { type ListedReading, type Template, compared, ofOthers } from "../src/model/readings.ts";
import type { Vec3 } from "../src/model/space.ts";
import { speak } from "../src/base/i18n.ts";
import { holder, isNamed } from "../src/store/holder.ts";
import { Reading } from "../src/store/reading.ts";
import english from "../src/words.en.json";

const at = (id: string, position: Vec3, change: Partial<Finding> = {}): Finding => ({
  ...newFinding({ points_in_patient: [position], depth_mm: 8 }),
  id,
  ...change,
});
const ids = (list: readonly Finding[]): string => list.map(({ id }) => id).join();

test("findings within 10 mm agree, those of the other side do not, and each agrees with one at most", () => {
  const mine = [at("left", [20, 0, 30]), at("far", [0, 60, 0]), at("no", [5, 5, 5], { is_dismissed: true })];
  const theirs = [
    at("mirrored", [-20, 0, 30]),
    at("near", [20, 0, 39.9]),
    at("nearest", [20, 6, 30]),
    at("seen", [5, 5, 5]),
    at("beyond", [0, 60, 10.1]),
  ];
  const found = compared(mine, theirs);
  assert.deepEqual(
    found.both.map((pair) => ids(pair)),
    ["left,nearest"],
  );
  assert.deepEqual([ids(found.mine), ids(found.theirs)], ["far", "mirrored,near,seen,beyond"]);
  // Who is asked first does not matter.
  const turned = compared(theirs, mine);
  assert.deepEqual([ids(turned.mine), ids(turned.theirs)], ["mirrored,near,seen,beyond", "far"]);
});

test("of each other reader the last signed version counts, and an open one if none is signed", () => {
  const one = (reader: string, version: number, state: "open" | "signed", is_mine = false): ListedReading => ({
    reader,
    version,
    state,
    is_mine,
    is_shown: false,
  });
  const all = [
    one("ana", 1, "signed", true),
    one("ben", 1, "signed"),
    one("ben", 2, "signed"),
    one("ben", 3, "open"),
    one("carla", 1, "open"),
  ];
  assert.deepEqual(
    ofOthers(all).map(({ reader, version }) => `${reader} ${version}`),
    ["ben 2", "carla 1"],
  );
});

// -- To the server and back

interface Stored {
  version: number;
  state: "open" | "signed";
  conclusion: string;
  template: Template;
  findings: readonly Finding[];
}

/** A server with the reading of whoever is signed in. */
class Server {
  reader = "proxy:ana";
  mine: Stored = { version: 1, state: "open", conclusion: "", template: {}, findings: [] };
  tag = 1;
  readonly seen: string[] = [];
  isAway = false;
  isDeleted = false;
  /** What happens while the next change is sent. */
  during: (() => void) | null = null;

  readonly fetch = async (path: unknown, { method = "GET", headers = {}, body }: RequestInit = {}) => {
    if (this.isAway) throw new TypeError("unreachable");
    if (String(path).endsWith("/readings")) return Response.json({ readings: [] });
    if (this.isDeleted) return new Response("", { status: 404 });
    this.seen.push(method);
    if (method !== "GET") this.during?.();
    if (method !== "GET") this.during = null;
    const known = (headers as Readonly<Record<string, string>>)["if-match"];
    if (method !== "GET" && known !== `"${this.tag}"`) return new Response("", { status: 412 });
    if (method === "PUT") {
      const { conclusion, template, findings } = JSON.parse(String(body)) as Stored;
      const isSigned = this.mine.state === "signed";
      this.put({ version: this.mine.version + (isSigned ? 1 : 0), state: "open", conclusion, template, findings });
    }
    if (method === "POST") this.put({ ...this.mine, state: "signed" });
    return Response.json({ reader: this.reader, ...this.mine }, { headers: { etag: `"${this.tag}"` } });
  };

  put(stored: Stored): void {
    this.mine = stored;
    this.tag += 1;
  }
}

type Hear = (event: Event) => void;

let server: Server;
/** Who hears of events of the page. */
const listening = new Set<Hear>();
let reading: Reading;
const list = signal<readonly Finding[]>([]);

beforeEach(async () => {
  speak("en", english);
  mock.timers.enable({ apis: ["setTimeout"] });
  server = new Server();
  mock.method(globalThis, "fetch", server.fetch);
  listening.clear();
  const target = {
    addEventListener: (_: string, hear: Hear) => listening.add(hear),
    removeEventListener: (_: string, hear: Hear) => listening.delete(hear),
  };
  Object.assign(globalThis, target, { document: { ...target, hidden: true } });
  holder.value = { name: "proxy:ana", scopes: ["read", "write"] };
  list.value = [at("a", [1, 2, 3])];
  reading = Reading.of("0".repeat(32), list);
  await reading.load();
  server.seen.length = 0;
});

afterEach(() => {
  mock.timers.reset();
  mock.restoreAll();
  holder.value = null;
});

test("a conclusion is sent as soon as the hand rests, and again once the server is back", async () => {
  reading.write({ conclusion: "Thick" });
  reading.write({ conclusion: "Thick gyrus\r\nleft\u202e" });
  assert.ok(!reading.isKept);
  mock.timers.tick(500);
  await reading.flush();
  assert.deepEqual([server.mine.conclusion, server.seen], ["Thick gyrus\nleft", ["PUT"]]);
  assert.equal(reading.status.value, english["findings.kept"]);
  server.isAway = true;
  reading.write({ conclusion: "Thin" });
  mock.timers.tick(500);
  await assert.rejects(reading.flush());
  assert.match(reading.status.value, /Not stored yet/);
  server.isAway = false;
  mock.timers.tick(5000);
  await reading.flush();
  assert.deepEqual([server.mine.conclusion, reading.status.value], ["Thin", english["findings.kept"]]);
});

test("what is signed has the findings as they are shown, stays, and is corrected by its next version", async () => {
  reading.write({ conclusion: "Thick" });
  assert.ok(await reading.sign(reading.seen));
  assert.deepEqual([server.mine.state, server.mine.conclusion, ids(server.mine.findings)], ["signed", "Thick", "a"]);
  assert.ok(reading.isSigned.value && reading.isKept);
  list.value = [...list.value, at("b", [9, 9, 9])];
  assert.equal(await reading.reported(), "proxy:ana");
  assert.equal(ids(server.mine.findings), "a", "a report changes nothing that is signed");
  assert.ok(await reading.correct());
  assert.deepEqual([server.mine.version, server.mine.state, server.mine.conclusion], [2, "open", "Thick"]);
  list.value = [at("c", [7, 7, 7])];
  await reading.reported();
  assert.equal(ids(server.mine.findings), "c");
});

test("what goes to a PACS is signed, and an emptied correction leaves the signed version in its place", async () => {
  reading.write({ conclusion: "Thick" });
  assert.deepEqual([await reading.reported(true), await reading.reported()], [null, "proxy:ana"]);
  assert.ok(await reading.sign(reading.seen));
  assert.equal(await reading.reported(true), "proxy:ana");
  assert.ok(await reading.correct());
  assert.equal(await reading.reported(true), null);
  reading.write({ conclusion: " " });
  assert.equal(await reading.reported(), "proxy:ana");
  assert.equal(server.mine.conclusion.trim(), "", "the server knows that nothing is left of the correction");
  assert.equal(await reading.reported(true), "proxy:ana");
});

test("what another window wrote meanwhile stays, and is never signed unseen", async () => {
  server.put({ ...server.mine, conclusion: "of the other window" });
  reading.write({ conclusion: "of this one" });
  await reading.flush();
  assert.equal(server.mine.conclusion, "of the other window\n\nof this one");
  assert.equal(reading.value.value.conclusion, server.mine.conclusion);
  server.put({ ...server.mine, conclusion: "another one" });
  assert.equal(await reading.sign(reading.seen), false);
  assert.deepEqual([server.mine.state, reading.value.value.conclusion], ["open", "another one"]);
  assert.equal(reading.status.value, english["problem.reading-changed"]);
  server.put({ ...server.mine, state: "signed" });
  assert.equal(await reading.sign(reading.seen), false);
  assert.equal(server.mine.version, 1);
});

test("what is signed is what was seen when the reader was asked", async () => {
  reading.write({ conclusion: "Thick" });
  const { seen } = reading;
  list.value = [at("a", [1, 2, 3]), at("b", [9, 9, 9])];
  assert.equal(await reading.sign(seen), false);
  assert.equal(reading.status.value, english["problem.reading-changed"]);
  server.during = () => (list.value = []);
  assert.equal(await reading.sign(reading.seen), false);
  assert.equal(server.mine.state, "open");
  // The server adds a side, which nobody has written.
  server.during = () => (list.value = [at("c", [7, 7, 7], { side: "left" })]);
  list.value = [at("c", [7, 7, 7])];
  assert.ok(await reading.sign(reading.seen));
  assert.equal(ids(server.mine.findings), "c");
});

test("what is typed while another window signs is kept for the correction", async () => {
  reading.write({ conclusion: "Thick" });
  await reading.flush();
  server.put({ ...server.mine, state: "signed" });
  reading.write({ conclusion: "Thick, and blurred" });
  await assert.rejects(reading.flush());
  assert.ok(reading.isSigned.value && !reading.isKept);
  await reading.load();
  await reading.flush();
  assert.deepEqual([server.mine.version, reading.value.value.conclusion], [1, "Thick, and blurred"]);
  assert.ok(await reading.correct());
  assert.deepEqual([server.mine.version, server.mine.state, server.mine.conclusion], [2, "open", "Thick, and blurred"]);
  assert.ok(reading.isKept);
});

test("what is deleted while it is sent does not come back", async () => {
  reading.write({ conclusion: "A" });
  await reading.flush();
  server.during = () => reading.write({ conclusion: "A" });
  reading.write({ conclusion: "AB" });
  await reading.flush();
  assert.deepEqual([server.mine.conclusion, reading.value.value.conclusion], ["A", "A"]);
  assert.deepEqual(server.seen, ["PUT", "PUT", "PUT"]);
});

test("fixed words are kept field by field, and joined with what another window chose", async () => {
  reading.write({ template: { side: "left", blur: "present" } });
  await reading.flush();
  assert.deepEqual(server.mine.template, { side: "left", blur: "present" });
  assert.ok(reading.isBegun.value, "they are a conclusion without a text");
  // The other window takes back the blur and states a lobe, this one another side.
  server.put({ ...server.mine, template: { side: "left", lobe: "insula" } });
  reading.write({ template: { side: "right", blur: "present" } });
  await reading.flush();
  assert.deepEqual(server.mine.template, { side: "right", lobe: "insula" });
  const { seen } = reading;
  reading.write({ template: { side: "right" } });
  assert.equal(await reading.sign(seen), false, "what is signed was seen");
  assert.ok(await reading.sign(reading.seen));
});

test("a conclusion that is taken back takes the findings with it", async () => {
  reading.write({ conclusion: "Thick" });
  await reading.flush();
  assert.equal(ids(server.mine.findings), "a");
  reading.write({ conclusion: " \n" });
  await reading.flush();
  assert.deepEqual([server.mine.conclusion.trim(), server.mine.findings], ["", []]);
});

test("whoever signs in next on the same page neither sees nor sends what the one before has written", async () => {
  server.isAway = true;
  reading.write({ conclusion: "of Ana" });
  await assert.rejects(reading.flush());
  server.isAway = false;
  const ofAna = server.mine;
  server.reader = "proxy:ben";
  server.put({ ...ofAna, conclusion: "of Ben" });
  await reading.flush();
  assert.deepEqual([reading.value.value.conclusion, server.mine.conclusion], ["of Ben", "of Ben"]);
  server.reader = "proxy:ana";
  server.put(ofAna);
  await reading.load();
  assert.equal(reading.value.value.conclusion, "of Ana");
  server.isAway = true;
  reading.dispose();
  holder.value = { name: "proxy:ben", scopes: ["read", "write"] };
  assert.equal(Reading.of("0".repeat(32), list).value.value.conclusion, "");
  holder.value = { name: "proxy:ana", scopes: ["read", "write"] };
  const again = Reading.of("0".repeat(32), list);
  assert.equal(again.value.value.conclusion, "of Ana");
  server.isAway = false;
  await again.flush();
  assert.equal(server.mine.conclusion, "of Ana");
});

test("a reader signs only what they themselves have seen", async () => {
  reading.write({ conclusion: "Normal." });
  await reading.flush();
  const { seen } = reading;
  server.reader = "proxy:ben";
  server.put({ ...server.mine });
  assert.equal(await reading.sign(seen), false);
  assert.deepEqual([server.mine.state, reading.value.value.conclusion], ["open", "Normal."]);
  assert.ok(await reading.sign(reading.seen));
});

test("the page warns while it has what the reader before has not sent, who finds it again", async () => {
  const warns = (): boolean => {
    const event = new Event("beforeunload", { cancelable: true });
    for (const hear of listening) hear(event);
    return event.defaultPrevented;
  };
  reading.write({ conclusion: "Thick" });
  await reading.flush();
  assert.ok(!warns());
  server.isAway = true;
  reading.write({ conclusion: "Thick, blurred" });
  await assert.rejects(reading.flush());
  server.isAway = false;
  const ofAna = server.mine;
  server.reader = "proxy:ben";
  server.put({ ...ofAna, conclusion: "of Ben" });
  await reading.flush();
  assert.ok(reading.isKept && warns());
  reading.dispose();
  await reading.flush();
  assert.ok(warns());
  server.reader = "proxy:ana";
  server.put(ofAna);
  const again = Reading.of("0".repeat(32), list);
  await again.load();
  await again.flush();
  assert.equal(server.mine.conclusion, "Thick, blurred");
  assert.ok(!warns());
});

test("what was not sent of a case that was left is shown again, and the page warns until it is sent", async () => {
  server.isAway = true;
  reading.write({ conclusion: "Thick" });
  reading.dispose();
  mock.timers.tick(0);
  await assert.rejects(reading.flush());
  assert.equal(listening.size, 1);
  const again = Reading.of("0".repeat(32), list);
  assert.equal(again.value.value.conclusion, "Thick");
  again.dispose();
  server.isAway = false;
  await again.flush();
  assert.deepEqual([server.mine.conclusion, listening.size], ["Thick", 0]);
});

test("of a deleted case nothing is left to be sent, and a page in the background sends what there is", async () => {
  reading.write({ conclusion: "Thick" });
  for (const hear of listening) hear(new Event("visibilitychange", { cancelable: true }));
  await reading.flush();
  assert.equal(server.mine.conclusion, "Thick");
  reading.write({ conclusion: "Thin" });
  server.isDeleted = true;
  reading.dispose();
  await assert.rejects(reading.flush());
  assert.equal(listening.size, 0);
});

test("everybody's token and this machine are nobody", () => {
  const named = (name: string): boolean => {
    holder.value = { name, scopes: [] };
    return isNamed.value;
  };
  assert.deepEqual(["anybody", "token", "ana", "proxy:token"].map(named), [false, false, true, true]);
  holder.value = null;
  assert.ok(!isNamed.value);
});
