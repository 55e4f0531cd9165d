// The findings of two readers as one list, what a reader types, and how all of it comes to the server.

import assert from "node:assert/strict";
import { afterEach, beforeEach, mock, test } from "node:test";

import {
  type Finding,
  areSame,
  isOff,
  joined,
  markedFindings,
  merged,
  newFinding,
  plainFinding,
  readFindings,
  signed,
  withOneAcpc,
} from "../src/model/findings.ts";
import type { Depths } from "../src/model/isosurface.ts";
import {
  type Line,
  type Mark,
  covered,
  freeOf,
  lettered,
  pieces,
  sliceMarks,
  surfaceMarks,
  thinned,
} from "../src/model/marks.ts";
import type { Vec3 } from "../src/model/space.ts";
import { excessOf, plainLine, plainText } from "../src/model/text.ts";
import { effect } from "@preact/signals";
import { speak } from "../src/base/i18n.ts";
import { FindingsSync } from "../src/store/findings-sync.ts";
import english from "../src/words.en.json";

const finding = (id: string, change: Partial<Finding> = {}): Finding => ({
  ...newFinding({ points_in_patient: [[1, 2, 3]], depth_mm: 8 }),
  id,
  ...change,
});
const [a, b] = [finding("a"), finding("b")];
const notes = (list: readonly Finding[]): readonly string[] => list.map(({ id, note }) => `${id}:${note}`);

test("what one reader has changed is as that one left it", () => {
  const mine = [finding("a", { note: "mine" }), b];
  const theirs = [a, finding("b", { note: "theirs" })];
  for (const [own, other] of [
    [mine, theirs],
    [theirs, mine],
  ] as const) {
    const { list, moved } = merged([a, b], own, other);
    assert.deepEqual([notes(list), moved.length], [["a:mine", "b:theirs"], 0]);
  }
});

test("what both have changed is kept as both left it", () => {
  const { list, moved } = merged([a, b], [finding("a", { note: "mine" }), b], [finding("a", { note: "theirs" }), b]);
  assert.equal(moved.length, 1);
  assert.deepEqual(list.map(({ note }) => note).sort(), ["", "mine", "theirs"]);
  assert.equal(new Set(list.map(({ id }) => id)).size, 3);
  // The server's keeps its id, so that everybody means the same by it.
  assert.equal(list.find(({ id }) => id === "a")?.note, "theirs");
});

test("what one has deleted and the other changed is there", () => {
  const changed = finding("a", { note: "changed" });
  for (const [own, other] of [
    [[b], [changed, b]],
    [[changed, b], [b]],
  ] as const) {
    const { list, moved } = merged([a, b], own, other);
    assert.deepEqual([notes(list).toSorted(), moved.length], [["a:changed", "b:"], 0]);
  }
});

test("the same change of both is one, and what nobody or both want is gone", () => {
  const same = finding("a", { note: "same" });
  // The server adds a side and times, which nobody has written.
  const stored = { ...same, side: "left", changed_at: "2026-01-01T00:00:00Z" } as const;
  const both = merged([a], [same], [stored]);
  assert.deepEqual([both.list, both.moved.length], [[stored], 0]);
  assert.deepEqual(merged([a, b], [b], [a, b]).list, [b]);
  assert.deepEqual(merged([a, b], [a, b], [a]).list, [a]);
  assert.deepEqual(merged([a, b], [b], [b]).list, [b]);
});

test("additions of both are there, and the list of the other one comes first", () => {
  const { list, moved } = merged([a], [a, finding("mine")], [a, finding("theirs")]);
  assert.deepEqual([list.map(({ id }) => id), moved.length], [["a", "theirs", "mine"], 0]);
  // Joined again with what it became, it stays as it is.
  assert.ok(areSame(merged([a, finding("theirs")], list, list).list, list));
});

const commissures = (id: string, change: Partial<Finding> = {}): Finding =>
  finding(id, {
    ...{ kind: "acpc", ...change },
    points_in_patient: [
      [0, -12, 0],
      [0, 12, 0],
    ],
  });

test("a list has the commissures once: those of this reader, or of a file", () => {
  const [own, theirs] = [commissures("own"), commissures("theirs")];
  const idsOf = (list: readonly Finding[]): string => list.map(({ id }) => id).join(" ");
  const both = merged([a], [a, own], [a, theirs]);
  assert.deepEqual([idsOf(both.list), both.moved.length], ["a own", 0]);
  const changed = merged([own], [commissures("own", { note: "mine" })], [commissures("own", { note: "theirs" })]);
  assert.deepEqual([notes(changed.list), changed.moved.length], [["own:mine"], 0]);
  // Those that are dismissed or unconfirmed state nothing.
  const taken = commissures("taken", { is_unconfirmed: true });
  const dismissed = commissures("dismissed", { is_dismissed: true });
  assert.equal(idsOf(merged([], [own], [taken, dismissed]).list), "taken dismissed own");
  const read = joined([own, a], [commissures("own", { note: "of the file" }), b]);
  assert.deepEqual([read.list.map(({ note }) => note), idsOf(read.list.slice(1))], [["of the file", "", ""], "a b"]);
  assert.equal(read.doubled, 0);
  assert.equal(idsOf(joined([own, a], [theirs]).list), "a theirs");
  assert.equal(idsOf(joined([own, a], [own]).list), "own a");
  // A reader measures them again, or confirms the ones of another case.
  assert.equal(idsOf(withOneAcpc([own, taken, theirs], (one) => one === theirs)), "taken theirs");
});

test("the anterior commissure is the first one in whatever order both were set", () => {
  const points: readonly Vec3[] = [
    [1, 12, 3],
    [-1, -12, 5],
  ];
  const set = (kind: Finding["kind"]) => newFinding({ kind, points_in_patient: points, depth_mm: 8 }).points_in_patient;
  assert.deepEqual(set("acpc"), points.toReversed());
  assert.deepEqual(
    set("acpc"),
    newFinding({ kind: "acpc", points_in_patient: set("acpc"), depth_mm: 8 }).points_in_patient,
  );
  assert.deepEqual(set("trajectory"), points);
});

test("a finding that comes back has the number that it had", () => {
  const ids = (own: readonly Finding[], other: readonly Finding[]): string =>
    merged([a, b], own, other)
      .list.map(({ id }) => id)
      .join(" ");
  const [first, middle, last] = [finding("first"), finding("middle"), finding("last")];
  assert.equal(ids([first, a, middle, b, last], [a, b]), "first a middle b last");
  assert.equal(ids([a, middle, b], [a, b, last]), "a middle b last");
});

test("what a reader types is cleaned of what the server refuses", () => {
  assert.equal(plainLine(" thick\tgyrus\r\n\u202eleft\u2069\u0000 ", 200), "thick gyrus left");
  assert.equal(plainText("one\ttwo\r\nthree\rfour\u202a\u0007", 200), "one two\nthree\nfour ");
  // Halves of characters, and characters that are made of several.
  assert.equal(plainText("a\ud800b \u{1f9e0} 👩‍⚕️ נכון می‌خواهم", 200), "ab \u{1f9e0} 👩‍⚕️ נכון می‌خواهم");
  assert.equal(plainText("\u{1f9e0}".repeat(4), 3), "\u{1f9e0}".repeat(3));
  const wrong = finding("a", { label: "a\tb", note: "x\u2066\ny", author: "\u202eme" });
  const { label, note, author } = plainFinding(wrong);
  assert.deepEqual([label, note, author], ["a b", "x\ny", "me"]);
  assert.ok(!("author" in plainFinding(a)));
});

test("a finding that does not lie on the surface of its depth is dashed there, where it was marked", () => {
  // Depth is measured along x.
  const along = ([x]: readonly number[]): number => x ?? NaN;
  const depths: Depths = { voxel_mm: 1, depthAt: along, smoothAt: along, inwardAt: () => [1, 0, 0] };
  const line = (from: number, to: number): Finding => ({
    ...finding("line", {
      kind: "line",
      points_in_patient: [
        [from, 0, 0],
        [to, 9, 0],
      ],
    }),
    depth_mm: 8,
  });
  const [on, across] = [line(8, 8.5), line(2, 14)];
  assert.deepEqual([isOff(depths, on), isOff(depths, across), isOff(depths, line(NaN, 8))], [false, true, false]);
  const marked = markedFindings(
    [on, across],
    new Set(),
    () => [0, 0, 0],
    (one) => isOff(depths, one),
  );
  const marks = surfaceMarks(marked, 8, { pixelOf: ([x, y]) => [x, y, 1] });
  assert.deepEqual(
    marks.map(({ isAway, parts }) => [isAway, parts[0]?.[0]]),
    [[false, [8, 0]]],
    "a line across the surface is not on it",
  );
});

test("a line is drawn without places that nobody could tell apart, in pieces that hang together", () => {
  const line: Line = Array.from({ length: 1001 }, (_, at) => [at / 2, 0]);
  const seen = thinned(line);
  assert.deepEqual([seen.length, seen[0], seen[1], seen.at(-1)], [335, [0, 0], [1.5, 0], [500, 0]]);
  assert.deepEqual(thinned([[4, 2]]), [[4, 2]]);

  const lines: readonly Line[] = [seen, [[4, 2]], seen.slice(0, 2), seen.slice(0, 90)];
  const groups = pieces(lines);
  assert.ok(groups.every((group) => group.flat().length <= 101));
  // Every part of every line is there once, and the single place too.
  const partsOf = (all: readonly Line[]): readonly string[] =>
    all.flatMap((one) => (one.length === 1 ? [String(one)] : one.slice(1).map((to, at) => `${one[at]} ${to}`)));
  assert.deepEqual(partsOf(groups.flat()), partsOf(lines));
});

test("a slice shows what lies near to it, and of thousands no other", () => {
  const line = (from: number, to: number): Finding =>
    finding("line", {
      kind: "line",
      points_in_patient: [
        [0, 5, from],
        [9, 0, to],
      ],
    });
  const marked = markedFindings([line(-9, 9), line(5, 40), line(-40, -5), line(2, 3)], new Set(), (point) => point);
  const marks = sliceMarks(
    marked,
    ([, , z]) => z,
    ([x, y]) => [x, y],
  );
  assert.deepEqual(
    marks.map(({ words, isAway }) => [words, isAway]),
    [
      ["1", false],
      ["4", true],
    ],
  );
});

test("a line that lies in one slice is in its plane alone, and its value stands only where all of it is seen", () => {
  const measure = (points_in_patient: readonly Vec3[]) => ({
    words: "31.6 mm",
    points_in_patient,
    isClosed: false,
    colour: "#7dffa0",
    depth_mm: null,
    isOnSurface: false,
    isValue: true,
    pointsAt: () => points_in_patient,
  });
  const [flat, slanted] = [
    measure([
      [0, 0, 20],
      [30, 10, 20],
    ]),
    measure([
      [0, 0, 20],
      [30, 10, 40],
    ]),
  ];
  const seen = (axis: 0 | 1 | 2, at: number) =>
    sliceMarks(
      [flat, slanted],
      (point) => point[axis] - at,
      ([x, y]) => [x, y],
    ).map(({ words, isAway }) => [words, isAway]);
  assert.deepEqual(seen(2, 20), [
    ["31.6 mm", false],
    ["", false],
  ]);
  assert.deepEqual(seen(2, 22), [
    ["31.6 mm", true],
    ["", false],
  ]);
  assert.deepEqual([seen(0, 10), seen(1, 5)], [[["", false]], [["", false]]], "across its plane there is none");
});

test("a point is a number at the end of a line that leaves 5 mm around it free", () => {
  const free = freeOf(0.25, [300, 300]);
  assert.equal(free, 20);
  assert.deepEqual([freeOf(5, [300, 300]), freeOf(0.01, [300, 300])], [6, 134], "neither hidden nor out of sight");
  const [one] = lettered([mark("1", 150, 150)], [300, 300], () => 7, { free });
  const away = one?.hair?.map(([x, y]) => Math.round(Math.hypot(x - 150, y - 150)));
  assert.deepEqual(away, [20, 44]);
  assert.ok(one && one.box[0] > 150 + 44 * Math.SQRT1_2);
});

// -- To the server and back

/** A server with one list, which does what it is told to with the next requests. */
class Server {
  list: readonly Finding[] = [];
  /** The findings of another case. */
  other: readonly Finding[] = [];
  version = 1;
  readonly seen: string[] = [];
  /** Statuses of the next answers; 0: none. */
  readonly fails: number[] = [];
  /** What happens before the next request is answered. */
  before: (() => void | Promise<void>) | null = null;

  readonly fetch = async (_: unknown, { method = "GET", headers = {}, body }: RequestInit = {}): Promise<Response> => {
    const known = (headers as Readonly<Record<string, string>>)["if-match"] ?? "";
    this.seen.push(method === "GET" ? method : `${method} ${known}`);
    const { before } = this;
    this.before = null;
    await before?.();
    const status = this.fails.shift();
    if (status === 0) throw new TypeError("unreachable");
    if (status) return new Response("", { status });
    if (method === "PUT") {
      if (known === "") return new Response("", { status: 428 });
      if (known !== this.#tag) return new Response("", { status: 412 });
      this.put(JSON.parse(String(body)).findings as Finding[]);
    }
    if (method === "POST") {
      if (known !== this.#tag) return new Response("", { status: 412 });
      const ids = new Set(this.list.map(({ id }) => id));
      const added = this.other.filter(({ id }) => !ids.has(id));
      this.put([...this.list, ...added.map((one) => ({ ...one, is_unconfirmed: true }) as const)]);
    }
    return Response.json({ findings: this.list }, { headers: { etag: this.#tag } });
  };

  put(list: readonly Finding[]): void {
    this.list = list.map((one) => ({ ...one, side: "left" }));
    this.version += 1;
  }

  get #tag(): string {
    return `"${this.version}"`;
  }
}

let server: Server;
let sync: FindingsSync;
let told: string[];
let doubled: number;

beforeEach(() => {
  mock.timers.enable({ apis: ["setTimeout"] });
  speak("en", english);
  server = new Server();
  mock.method(globalThis, "fetch", server.fetch);
  [told, doubled] = [[], 0];
  sync = new FindingsSync("0".repeat(32));
  effect(() => {
    told.push(sync.status.value);
  });
  effect(() => {
    doubled += Number(/\d+/.exec(sync.doubled.value));
  });
});

afterEach(() => {
  mock.timers.reset();
  mock.restoreAll();
});

const settled = (): Promise<void> => new Promise((resolve) => setImmediate(resolve));
/** Lets so much time pass, and what it has begun be done. */
async function pass(ms: number): Promise<void> {
  mock.timers.tick(ms);
  for (let round = 0; round < 20; round += 1) await settled();
}

test("flush resolves when the server has the list, also what was written while another one was on its way", async () => {
  await sync.load();
  sync.change([a]);
  server.before = () => sync.change([finding("a", { note: "the last sentence" })]);
  await sync.flush();
  assert.deepEqual(notes(server.list), ["a:the last sentence"]);
  assert.deepEqual([sync.isKept, told.at(-1)], [true, english["findings.kept"]]);
  // There is nothing more to send.
  const requests = server.seen.length;
  await sync.flush();
  await pass(60_000);
  assert.equal(server.seen.length, requests);
});

test("what another reader writes is seen, and nothing changes as long as nobody writes", async () => {
  await sync.look();
  assert.deepEqual(server.seen, [], "what has not been read yet is not looked after");
  await sync.load();
  const before = sync.value.peek();
  await sync.look();
  assert.equal(sync.value.peek(), before);
  server.put([a]);
  await sync.look();
  assert.deepEqual(notes(sync.value.peek()), ["a:"]);
  // What is written here is joined with it when it is sent.
  const requests = server.seen.length;
  sync.change([...sync.value.peek(), b]);
  await sync.look();
  assert.equal(server.seen.length, requests);
});

test("flush waits for a list that is on its way, and rejects if the server cannot have it", async () => {
  await sync.load();
  sync.change([a]);
  server.before = settled;
  mock.timers.tick(500);
  await sync.flush();
  assert.deepEqual(server.seen, ["GET", 'PUT "1"']);
  server.fails.push(503);
  sync.change([a, b]);
  await assert.rejects(sync.flush());
  assert.match(told.at(-1) ?? "", /^Not stored yet/);
  // It is sent again by itself.
  await pass(5000);
  assert.deepEqual([server.list.length, told.at(-1)], [2, english["findings.kept"]]);
});

test("after a first load that failed, what is stored is read before anything is sent", async () => {
  server.put([b]);
  server.fails.push(503);
  assert.equal(await sync.load(), false);
  sync.change([a]);
  await sync.flush();
  assert.deepEqual(server.list.map(({ id }) => id).sort(), ["a", "b"]);
  assert.deepEqual(server.seen, ["GET", "GET", 'PUT "2"']);
});

test("a later load sends what it has joined", async () => {
  server.fails.push(503, 503);
  assert.equal(await sync.load(), false);
  sync.change([a]);
  await assert.rejects(sync.flush());
  server.put([b]);
  await sync.load();
  await pass(0);
  assert.deepEqual(server.list.map(({ id }) => id).sort(), ["a", "b"]);
});

test("a list that others have changed, or that the server was not told of, is joined and sent at once", async () => {
  await sync.load();
  for (const status of [428, 412]) {
    server.put([...server.list, finding(`theirs-${status}`)]);
    server.fails.push(status);
    sync.change([...sync.value.value, finding(`mine-${status}`)]);
    await sync.flush();
  }
  const ids = server.list.map(({ id }) => id).sort();
  assert.deepEqual(ids, ["mine-412", "mine-428", "theirs-412", "theirs-428"]);
  assert.ok(!told.some((words) => words.includes("accept")));
  server.put(server.list.map((one) => ({ ...one, note: "theirs" })));
  sync.change(sync.value.value.map((one) => (one.id === "mine-412" ? { ...one, note: "mine" } : one)));
  await sync.flush();
  assert.equal(doubled, 1);
  assert.equal(server.list.length, 5);
});

test("an answer that comes late never takes back what was sent meanwhile", async () => {
  await sync.load();
  // The list is read again, and changed before it is answered.
  let answer = (): void => {};
  server.before = () => new Promise((resolve) => (answer = resolve));
  const loading = sync.load();
  await settled();
  sync.change([a]);
  const flushed = sync.flush();
  await settled();
  answer();
  await Promise.all([loading, flushed]);
  assert.deepEqual([notes(sync.value.value), notes(server.list)], [["a:"], ["a:"]]);
});

test("findings of another case come beside what is not sent yet, and are confirmed one by one", async () => {
  server.put([b]);
  await sync.load();
  server.other = [a, b];
  sync.change([...sync.value.value, finding("mine")]);
  await sync.flush();
  // Somebody else is faster.
  server.before = () => server.put(server.list.map((one) => (one.id === "b" ? { ...one, note: "theirs" } : one)));
  await sync.takeOver("1".repeat(32));
  const told = (): readonly string[] =>
    sync.value.value.map(({ id, is_unconfirmed = false }) => `${id}:${is_unconfirmed}`);
  assert.deepEqual(told(), ["b:false", "mine:false", "a:true"]);
  assert.deepEqual(server.seen, ["GET", 'PUT "2"', 'POST "3"', "GET", 'POST "4"']);
  assert.equal(sync.value.value[0]?.note, "theirs");
  assert.ok(sync.isKept);
  const confirmed = sync.value.value.map(({ is_unconfirmed: _before, ...one }) => one);
  sync.change(confirmed);
  await sync.flush();
  assert.ok(server.list.every((one) => !one.is_unconfirmed));
  const marked = (list: readonly Finding[]) =>
    markedFindings(list, new Set(), (point) => point).map(({ words }) => words);
  assert.deepEqual(marked([a, finding("c", { is_unconfirmed: true })]), ["1", "2?"]);
});

test("what the server refuses stays in the page, and is not sent again until it is changed", async () => {
  await sync.load();
  server.fails.push(400);
  sync.change([a]);
  await assert.rejects(sync.flush());
  assert.match(told.at(-1) ?? "", /does not accept/);
  await pass(60_000);
  assert.deepEqual([server.list.length, sync.value.value.length, server.seen.length], [0, 1, 2]);
  sync.change([b]);
  await sync.flush();
  assert.deepEqual(notes(server.list), ["b:"]);
});

test("a file of findings is taken by the server or not at all, and what it replaces stays", async () => {
  await sync.load();
  sync.change([a]);
  // A list of a file comes in the place of what is stored, and is joined with what was there.
  await sync.take(
    () => JSON.stringify({ findings: [b] }),
    "application/dicom",
    (now, given) => joined(now, given).list,
  );
  assert.deepEqual(
    [notes(sync.value.value), notes(server.list)],
    [
      ["a:", "b:"],
      ["a:", "b:"],
    ],
  );
  // What is refused leaves the list as it is, and does not block it.
  server.fails.push(400);
  await assert.rejects(
    sync.take(
      () => "{}",
      "application/json",
      (_now, given) => given,
    ),
  );
  sync.change([...sync.value.value, finding("c")]);
  await sync.flush();
  assert.deepEqual(notes(server.list), ["a:", "b:", "c:"]);
  // What somebody else has added by the time the file is sent goes with it.
  server.put([...server.list, finding("theirs")]);
  sync.change([...sync.value.value, finding("d")]);
  await sync.take(
    (now) => JSON.stringify({ findings: joined(now, [finding("e")]).list }),
    "application/json",
    (_now, stored) => stored,
  );
  assert.deepEqual(notes(server.list).toSorted(), ["a:", "b:", "c:", "d:", "e:", "theirs:"]);
  assert.deepEqual(sync.value.value, server.list);
});

test("what could not be read is read again as soon as the server answers", async () => {
  server.put([a]);
  server.fails.push(503);
  assert.equal(await sync.load(), false);
  assert.equal(sync.isRead.value, false);
  await pass(6000);
  assert.deepEqual([sync.isRead.value, notes(sync.value.value), told.at(-1)], [true, ["a:"], ""]);
  await pass(60_000);
  assert.deepEqual(server.seen, ["GET", "GET"]);
});

test("what is not sent yet when a case is left is shown and sent when it is opened again", async () => {
  await sync.load();
  server.fails.push(503);
  sync.change([a]);
  await assert.rejects(sync.flush());
  server.put([b]);
  await sync.load();
  await pass(0);
  assert.deepEqual(
    [notes(sync.value.value), notes(server.list)],
    [
      ["b:", "a:"],
      ["b:", "a:"],
    ],
  );
});

test("findings of a file are added once, and where it says something else both are kept side by side", () => {
  const rounded = finding("a", { points_in_patient: [[1.0002, 2, 3]], side: "left" });
  const other = finding("a", { note: "of another reader" });
  assert.deepEqual(joined([a], [rounded]), { list: [a], doubled: 0 });
  const c = finding("c");
  const { list, doubled } = joined([a, c], [other, b, { ...c, gyrus: "insula" }]);
  assert.deepEqual(
    list.map(({ note }) => note),
    ["", "of another reader", "", ""],
  );
  assert.deepEqual([list[0]?.id, list[2]?.id, list[3]?.id, doubled], ["a", "c", "b", 1]);
  assert.equal(new Set(list.map(({ id }) => id)).size, 4);
  // What the server added is not the file's to say.
  const text = JSON.stringify({ findings: [{ ...a, side: "left", created_at: "x" }] });
  assert.deepEqual(readFindings(text), [a]);
  const bare = { id: "a", kind: "point", points_in_patient: [[1, 2, 3]], depth_mm: 8 };
  assert.deepEqual(readFindings(JSON.stringify({ findings: [bare] })), [a]);
  for (const wrong of ["", "[]", "null", "{}", '{"findings": [1]}', '{"findings": [{}]}', '{"findings": {}}'])
    assert.equal(readFindings(wrong), null, wrong);
  for (const change of [{ kind: "x" }, { points_in_patient: [] }, { points_in_patient: [[1, 2]] }, { note: 5 }])
    assert.equal(readFindings(JSON.stringify({ findings: [{ ...bare, ...change }] })), null);
});

const mark = (words: string, x: number, y: number) => ({
  words,
  parts: [[[x, y] as const]],
  colour: "#7dffa0",
  isAway: false,
});

test("the words of marks never run into one another", () => {
  const widthOf = (words: string): number => 7 * words.length;
  const near = [mark("90.0°", 100, 100), mark("153 mm²", 104, 101), mark("19.7 mm", 90, 99), mark("1", 100, 112)];
  const words = lettered(near, [300, 300], widthOf);
  assert.deepEqual(
    words.map((one) => one.mark.words),
    ["90.0°", "153 mm²", "19.7 mm", "1"],
  );
  for (const [first, one] of words.entries())
    for (const other of words.slice(first + 1)) {
      const isBeside =
        one.at[0] + widthOf(one.mark.words) < other.at[0] || other.at[0] + widthOf(other.mark.words) < one.at[0];
      assert.ok(isBeside || Math.abs(one.at[1] - other.at[1]) >= 14, `${one.mark.words} and ${other.mark.words}`);
    }
  // At the right edge words stand to the left of their mark.
  const [edge] = lettered([mark("19.7 mm", 290, 100)], [300, 300], widthOf);
  assert.ok(edge && edge.at[0] + widthOf("19.7 mm") < 290);
  // Where there is no room at all, some are left out; of many, each cell has one.
  const crowd = Array.from({ length: 60 }, (_, at) => mark(String(at), 100, 100 + at / 10));
  assert.ok(lettered(crowd, [300, 300], widthOf).length < 30);
  assert.equal(lettered(crowd, [300, 300], widthOf, { cell: [96, 48] }).length, 1);
});

const linesOf = (marks: readonly Mark[]): readonly Line[] => marks.flatMap(({ parts }) => parts);

test("the canvas of marks holds them and their words, within the pane, in steps", () => {
  const marks = [mark("1", 100, 100), mark("2", 290, 150)];
  const letters = lettered(marks, [300, 300], (words) => 7 * words.length);
  const given = { pane: [300, 300], reach: 10, step: 64 } as const;
  assert.deepEqual(covered(linesOf(marks), letters, given), [64, 64, 300, 192]);
  // Words reach farther than their mark.
  const [one] = marks;
  assert.ok(one);
  assert.deepEqual(covered(linesOf([one]), [], given), [64, 64, 128, 128]);
  assert.deepEqual(
    covered(
      linesOf([one]),
      lettered([one], [300, 300], () => 60),
      given,
    ),
    [64, 64, 192, 128],
  );
  // What lies beside the pane takes no room.
  const [left, , right] = covered(linesOf([mark("1", 400, 100)]), [], given);
  assert.equal(right - left, 0);
});

test("a finding has the author who made it, or the first one who changed it when it had none", () => {
  const unsigned = newFinding({ points_in_patient: [[1, 2, 3]], depth_mm: 8 });
  assert.equal(signed(unsigned, "").author, undefined);
  const own = signed(unsigned, "A. Reader");
  assert.equal(own.author, "A. Reader");
  assert.equal(signed(own, "B. Reader").author, "A. Reader");
});

test("a note that is too long says by how much", () => {
  assert.equal(excessOf("a".repeat(10_000), 10_000), 0);
  assert.equal(excessOf(`${"a".repeat(10_000)}\u{1f9e0}\r\n`, 10_000), 2);
});
