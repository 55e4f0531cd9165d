// What a named user has chosen: taken over from the server, and kept there when it changes.

import assert from "node:assert/strict";
import { after, before, test } from "node:test";

import { speak } from "../src/base/i18n.ts";
import { savedAs } from "../src/model/saved-layouts.ts";
import { firstState } from "../src/model/state.ts";
import { holder } from "../src/store/holder.ts";
import { followPerson, isKept } from "../src/store/person.ts";
import { choose, preferences } from "../src/store/preferences.ts";
import { addLayouts, layoutsFile, makeSteps, ownSteps, savedLayouts, takeLayouts } from "../src/store/saved-layouts.ts";
import { protocolNow, protocols, stepWords, stepsNow } from "../src/store/steps.ts";
import english from "../src/words.en.json";
import { SHOWN } from "./shown.ts";

const { fetch } = globalThis;
/** What the server has, and how often that has changed. */
let document: Record<string, unknown> = {};
let version = 1;
let asked: string[] = [];

before(() => {
  speak("en", english);
  const stored = new Map<string, string>();
  const localStorage = { getItem: (key: string) => stored.get(key) ?? null, setItem: stored.set.bind(stored) };
  Object.assign(globalThis, { window: globalThis, parent: globalThis, localStorage });
  globalThis.fetch = async (_path, { method = "GET", headers, body } = {}) => {
    asked.push(method);
    const answer = (status: number): Response =>
      new Response(JSON.stringify(document), {
        status,
        headers: { "content-type": "application/json", etag: `"${version}"` },
      });
    if (method === "GET") return answer(200);
    if ((headers as Record<string, string>)["if-match"] !== `"${version}"`) return answer(412);
    version += 1;
    document = JSON.parse(String(body)) as typeof document;
    return answer(200);
  };
});
after(() => void Object.assign(globalThis, { fetch }));

const layout = (name: string) => savedAs(name, firstState(SHOWN));

test("whoever has no name keeps all in the browser", async () => {
  holder.value = { name: "anybody", scopes: ["read"] };
  await followPerson();
  takeLayouts([layout("here")]);
  await isKept();
  assert.deepEqual(asked, []);
});

test("a named user has the same in every browser, and two windows do not undo each other", async () => {
  holder.value = { name: "proxy:ana", scopes: ["read"] };
  document = { choices: { theme: "light" }, layouts: [layout("there")], other: 1 };
  await followPerson();
  assert.equal(preferences.value.theme, "light");
  assert.deepEqual(
    savedLayouts.value.map(({ name }) => name),
    ["there"],
  );
  assert.deepEqual(asked, ["GET"], "what is taken over is not sent back");

  asked = [];
  choose({ wheel: "depth" });
  await isKept();
  assert.deepEqual(asked, ["PUT"]);
  assert.equal((document["choices"] as { wheel: string }).wheel, "depth");
  assert.equal(document["other"], 1, "a later page may keep more");

  // Another window has saved a layout in the meantime.
  document = { ...document, layouts: [layout("there"), layout("elsewhere")] };
  version += 1;
  asked = [];
  choose({ theme: "dark" });
  await isKept();
  assert.deepEqual(asked, ["PUT", "GET", "PUT"]);
  assert.equal((document["layouts"] as unknown[]).length, 2);
  assert.equal((document["choices"] as { theme: string }).theme, "dark");
});

test("saved layouts become one's own steps, and go to others as a file", async () => {
  takeLayouts([]);
  assert.deepEqual(protocols(), ["complete", "mirrored", "depths"]);
  choose({ protocol: "own" });
  assert.equal(protocolNow(), "complete", "there are none yet");
  takeLayouts([layout("left first"), { ...layout("close"), layout: "closer" }]);
  makeSteps();
  assert.equal(protocolNow(), "own");
  assert.deepEqual(stepsNow().map(stepWords), ["left first"]);
  const file = await layoutsFile().text();
  await isKept();
  assert.deepEqual(
    (document["steps"] as { name: string }[]).map(({ name }) => name),
    ["left first"],
  );

  takeLayouts([layout("mine")]);
  assert.match(addLayouts("{}"), /no layouts/);
  assert.match(addLayouts(file), /2$/);
  assert.deepEqual(
    savedLayouts.value.map(({ name }) => name),
    ["mine", "left first", "close"],
  );
  assert.equal(ownSteps.value.length, 1);
  takeLayouts(Array.from({ length: 8 }, (_, at) => layout(`n${at}`)));
  assert.match(addLayouts(file), /nine/);
  assert.equal(savedLayouts.value.length, 8, "all or nothing");
  await isKept();
});
