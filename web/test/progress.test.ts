import assert from "node:assert/strict";
import { afterEach, test } from "node:test";

import { Progress, casesOf } from "../src/base/progress.ts";
import { SHOWN } from "./shown.ts";

const realFetch = globalThis.fetch;
const realNavigator = Object.getOwnPropertyDescriptor(globalThis, "navigator");
afterEach(() => {
  globalThis.fetch = realFetch;
  if (realNavigator) Object.defineProperty(globalThis, "navigator", realNavigator);
});

const streamOf = (...pieces: readonly string[]): ReadableStream<Uint8Array> =>
  new ReadableStream({
    start(controller) {
      for (const piece of pieces) controller.enqueue(new TextEncoder().encode(piece));
      controller.close();
    },
  });

test("cases are read out of a stream, however it is cut", async () => {
  const event = `event: case\ndata: ${JSON.stringify({ ...SHOWN, name: "Ação" })}\n\n`;
  const heard: (string | null | undefined)[] = [];
  const pieces = [`: still here\n\n${event.slice(0, 20)}`, event.slice(20), "event: gone\ndata: {}\n\n", event];
  for await (const one of casesOf(streamOf(...pieces))) heard.push(one.name);
  assert.deepEqual(heard, ["Ação", "Ação"]);
});

test("of all pages of a browser one reads the stream, and the others hear it", async () => {
  // Locks as browsers have them: one holder after the other.
  let before: Promise<unknown> = Promise.resolve();
  const request = (_name: string, { signal }: { signal: AbortSignal }, hold: () => Promise<void>): Promise<unknown> =>
    (before = before.then(() => (signal.aborted ? undefined : hold())));
  Object.defineProperty(globalThis, "navigator", { value: { locks: { request } }, configurable: true });
  const asked: string[] = [];
  globalThis.fetch = async (input) => {
    asked.push(String(input));
    return new Response(streamOf(`event: case\ndata: ${JSON.stringify(SHOWN)}\n\n`));
  };
  const pages: Progress[] = [];
  const heard = await new Promise<string[]>((resolve) => {
    const all: string[] = [];
    const hear = (page: string) => () => {
      all.push(page);
      for (const one of pages) one.follow(null);
      if (all.length === 2) resolve(all);
    };
    pages.push(new Progress(hear("first")), new Progress(hear("second")));
    for (const one of pages) one.follow(SHOWN.id);
  });
  assert.deepEqual(heard.sort(), ["first", "second"]);
  assert.deepEqual(asked, [`v1/cases/${SHOWN.id}/events`]);
  for (const one of pages) one.dispose();
});
