// Requests by way of the kernel of a notebook.

import assert from "node:assert/strict";
import { test } from "node:test";

import { send } from "../src/base/api.ts";
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
    get: () => "a",
    set: () => {},
    save_changes: () => {},
    send: (asked) => void this.asked.push(asked as Asked),
    on: (_, hear) => void this.hearing.add(hear as unknown as Hear),
    off: (_, hear) => void this.hearing.delete(hear as unknown as Hear),
  };

  get paths(): readonly string[] {
    return this.asked.map(({ path }) => path);
  }

  answer(): void {
    for (const { ask, path } of this.asked.splice(0))
      for (const hear of this.hearing) hear({ answer: ask, status: 200, headers: {} }, [path]);
  }
}

test("two views of one case ask each its own Python", async () => {
  const [first, second] = [new Notebook(), new Notebook()];
  const [one, other] = [first, second].map(({ model }) => new Kernel(model));
  assert.ok(one && other);
  const asked = [one, other].map(({ own }) => send(`v1/cases/${own}/render?depth_mm=8`));
  await Promise.resolve();
  const path = "v1/cases/a/render?depth_mm=8";
  assert.deepEqual([first.paths, second.paths], [[path], [path]]);
  second.answer();
  assert.equal(await (await asked[1])?.text(), path);
  first.answer();
  assert.equal(await (await asked[0])?.text(), path);

  // What is not wanted any more is not waited for; the other view goes on.
  const gone = new AbortController();
  const given = assert.rejects(send(`v1/cases/${other.own}/parts`, { signal: gone.signal }));
  await Promise.resolve();
  gone.abort();
  await given;
  other.dispose();
  assert.equal(second.hearing.size, 0, "nobody is heard in vain");
  const again = send(`v1/cases/${one.own}`);
  await Promise.resolve();
  assert.deepEqual(first.paths, ["v1/cases/a"]);
  first.answer();
  assert.ok((await again).ok);
  one.dispose();
  assert.equal(first.hearing.size, 0);
});
