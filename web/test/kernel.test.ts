// Requests by way of the kernel of a notebook.

import assert from "node:assert/strict";
import { test } from "node:test";

import { carryBy, send } from "../src/base/api.ts";
import { Kernel, type Model } from "../src/widget/kernel.ts";

interface Asked {
  readonly ask: number;
  readonly path: string;
}

type Hear = (content: object, buffers: readonly BlobPart[]) => void;

/** A model whose Python answers when it is told to. */
class Notebook {
  readonly asked: Asked[] = [];
  readonly hearing = new Set<Hear>();
  readonly model: Model = {
    get: () => null,
    set: () => {},
    save_changes: () => {},
    send: (asked) => void this.asked.push(asked as Asked),
    on: (_, hear) => void this.hearing.add(hear as unknown as Hear),
    off: (_, hear) => void this.hearing.delete(hear as unknown as Hear),
  };

  answer(): void {
    for (const { ask, path } of this.asked.splice(0))
      for (const hear of this.hearing) hear({ answer: ask, status: 200, headers: {} }, [path]);
  }
}

test("what one view of a case has asked by way of another is answered when that one is gone", async () => {
  const [first, second] = [new Notebook(), new Notebook()];
  const kernels = [first, second].map(({ model }) => new Kernel(model));
  const releases = kernels.map(({ carry }) => carryBy("v1/cases/a", carry));
  const gone = new AbortController();
  const asked = send("v1/cases/a/case");
  const given = assert.rejects(send("v1/cases/a/parts", { signal: gone.signal }));
  await Promise.resolve();
  assert.deepEqual([first.asked.length, second.asked.length], [0, 2]);
  gone.abort();
  kernels[1]?.dispose();
  releases[1]?.();
  second.answer();
  await given;
  assert.equal(await (await asked).text(), "v1/cases/a/case");
  assert.deepEqual([second.hearing.size, first.hearing.size], [0, 1], "nobody is heard in vain");
  const again = send("v1/cases/a/case");
  first.answer();
  assert.ok((await again).ok);
  kernels[0]?.dispose();
  releases[0]?.();
  assert.equal(first.hearing.size, 0);
});
