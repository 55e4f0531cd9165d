// What a named user has chosen: taken over from the server, and kept there when it changes.

import assert from "node:assert/strict";
import { after, before, test } from "node:test";

import { speak } from "../src/base/i18n.ts";
import { own } from "../src/base/kept.ts";
import { savedAs } from "../src/model/saved-layouts.ts";
import { firstState } from "../src/model/state.ts";
import { noted } from "../src/store/announce.ts";
import { holder } from "../src/store/holder.ts";
import { followPerson, isKept } from "../src/store/person.ts";
import { choose, preferences, unfold } from "../src/store/preferences.ts";
import {
  addLayouts,
  layoutsFile,
  makeSteps,
  ownSteps,
  removeLayout,
  savedLayouts,
  takeLayouts,
  takeSteps,
} from "../src/store/saved-layouts.ts";
import { canShow, protocolNow, protocols, stepOnScreen, stepWords, stepsNow } from "../src/store/steps.ts";
import type { Store } from "../src/store/store.ts";
import english from "../src/words.en.json";
import { SHOWN } from "./shown.ts";

const { fetch } = globalThis;
/** Who is signed in, what the server has of them, and how often that has changed. */
let who = "proxy:ana";
let kept: Record<string, unknown> = {};
let version = 1;
let asked: string[] = [];
/** Whether a proxy between compresses, which makes weak tags. */
let isCompressed = false;
let isContested = false;
/** How many times it does not answer. */
let fails = 0;
const stored = new Map<string, string>();

before(() => {
  speak("en", english);
  const localStorage = { getItem: (key: string) => stored.get(key) ?? null, setItem: stored.set.bind(stored) };
  const document = { hidden: false, addEventListener: () => {} };
  Object.assign(globalThis, { window: globalThis, parent: globalThis, localStorage, document });
  globalThis.fetch = async (path, { method = "GET", headers, body } = {}) => {
    if (path === "v1/session") return Response.json({ name: who, scopes: ["read"] });
    asked.push(method);
    const tag = () => `"${who} ${version}"`;
    const answer = (status: number): Response =>
      new Response(JSON.stringify(kept), {
        status,
        headers: { "content-type": "application/json", etag: isCompressed ? `W/${tag()}` : tag() },
      });
    if (method === "GET") return answer(fails-- > 0 ? 503 : 200);
    if (isContested) version += 1;
    if (isContested || (headers as Record<string, string>)["if-match"] !== tag()) return answer(412);
    version += 1;
    kept = JSON.parse(String(body)) as typeof kept;
    return answer(200);
  };
});
after(() => void Object.assign(globalThis, { fetch }));

const layout = (name: string) => savedAs(name, firstState(SHOWN));
const names = (layouts: unknown): string[] => (layouts as { name: string }[]).map(({ name }) => name);

test("whoever has no name keeps all in the browser", async () => {
  holder.value = { name: "anybody", scopes: ["read"] };
  await followPerson();
  takeLayouts([layout("here")]);
  await isKept();
  assert.deepEqual(asked, []);
});

test("what another person has left in the browser is not taken over", async () => {
  assert.equal(own("proxy:zoe"), "");
  choose({ reader: "Zoe", panel: false });
  takeLayouts([layout("of Zoe")]);
  takeSteps([layout("step of Zoe")]);
  holder.value = { name: who, scopes: ["read"] };
  kept = { choices: { theme: "light" }, other: 1 };
  const isFollowed = followPerson();
  choose({ shortcuts: false });
  await isFollowed;
  assert.equal(preferences.value.theme, "light");
  assert.deepEqual([preferences.value.reader, preferences.value.panel], ["", true]);
  assert.deepEqual([savedLayouts.value, ownSteps.value], [[], []]);
  assert.deepEqual(asked, ["GET"], "what is taken over is not sent back");

  takeLayouts([layout("there")]);
  choose({ wheel: "depth" });
  await isKept();
  assert.deepEqual(names(kept["layouts"]), ["there"]);
  assert.equal((kept["choices"] as { shortcuts: boolean }).shortcuts, false, "chosen before the server had answered");
  assert.doesNotMatch(JSON.stringify([kept, ...stored.values()]), /Zoe/);
  assert.equal(kept["other"], 1, "a later page may keep more");
});

test("what is folded stays in the browser, and several changes are one", async () => {
  asked = [];
  choose({ panel: false, list: true, task: "case" });
  unfold("panel.point", false);
  await isKept();
  assert.deepEqual(asked, []);
  assert.match(stored.get("isocortex") ?? "", /"panel":false/);
  choose({ wheel: "zoom" });
  choose({ drag: "up-brighter" });
  await isKept();
  assert.deepEqual(asked, ["PUT"]);
  assert.doesNotMatch(JSON.stringify(kept["choices"]), /panel|unfolded|task|list"/);
});

test("two windows do not undo each other", async () => {
  // The other window has changed as much in the meantime.
  kept = {
    ...kept,
    choices: { ...(kept["choices"] as object), wheel: "depth", later: 1 },
    layouts: [layout("there"), layout("elsewhere")],
  };
  version += 1;
  asked = [];
  choose({ theme: "dark" });
  takeLayouts([{ ...layout("there"), depth_mm: 31 }, layout("mine")]);
  await isKept();
  assert.deepEqual(asked, ["PUT", "GET", "PUT"]);
  const { theme, wheel, later } = kept["choices"] as Record<string, unknown>;
  assert.deepEqual([theme, wheel, later], ["dark", "depth", 1]);
  assert.deepEqual(names(kept["layouts"]), ["there", "elsewhere", "mine"]);
  assert.equal((kept["layouts"] as { depth_mm: number }[])[0]?.depth_mm, 31);
  // It is here as well, so that the next change removes nothing.
  assert.equal(preferences.value.wheel, "depth");
  assert.deepEqual(names(savedLayouts.value), ["there", "elsewhere", "mine"]);

  removeLayout(1);
  await isKept();
  assert.deepEqual(names(kept["layouts"]), ["there", "mine"]);
});

test("weak tags of a proxy are no hindrance, and what is always contested is given up", async () => {
  isCompressed = true;
  choose({ theme: "light" });
  await isKept();
  choose({ theme: "dark" });
  await isKept();
  assert.equal((kept["choices"] as { theme: string }).theme, "dark");
  isCompressed = false;
  isContested = true;
  asked = [];
  choose({ theme: "light" });
  await isKept();
  assert.ok(asked.length < 12, String(asked));
  isContested = false;
  await isKept();
  assert.equal((kept["choices"] as { theme: string }).theme, "light");
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
  assert.deepEqual(names(kept["steps"]), ["left first"]);

  takeLayouts([layout("mine")]);
  assert.match(addLayouts("{}"), /no layouts/);
  assert.equal(addLayouts(file), "Layouts of the file: 2. Your own steps are now those of the file: 1.");
  assert.deepEqual(names(savedLayouts.value), ["mine", "left first", "close"]);
  assert.equal(ownSteps.value.length, 1);
  takeLayouts(Array.from({ length: 8 }, (_, at) => layout(`n${at}`)));
  assert.match(addLayouts(file), /nine/);
  assert.equal(savedLayouts.value.length, 8, "all or nothing");

  const steps = [layout("same"), { ...layout("same"), depth_mm: 9 }, layout("same")];
  assert.equal(addLayouts(JSON.stringify({ steps })), "Your own steps are now those of the file: 3.");
  assert.deepEqual(names(ownSteps.value), ["same", "same 2", "same 3"], "each is one to go to");
  takeLayouts([{ ...layout("close"), layout: "closer" }]);
  choose({ protocol: "complete" });
  assert.match(makeSteps(), /close-up/);
  assert.deepEqual([ownSteps.value.length, protocolNow()], [3, "complete"]);
  await isKept();
});

test("a step is passed over where the case does not have its series, and is on the screen in any direction if it has none", () => {
  const step = { ...layout("FLAIR"), view: null, series: { "slice-1": "layer:flair" } };
  const layers = (all: object[]) => ({ value: { layers: all }, peek: () => ({ layers: all }) });
  const storeOf = (all: object[]) => {
    const state = firstState(SHOWN);
    const view = { state: { value: { ...state, orientation: [0.1, 0.2, 0.3, 0.9] } } };
    return { step: { value: "FLAIR" }, shown: SHOWN, view, caseLayers: { list: layers(all) } } as unknown as Store;
  };
  const flair = { id: "f", kind: "mr", contrast: "flair", state: "ready", window: [0, 9] };
  assert.equal(canShow(storeOf([]), step), false);
  assert.equal(canShow(storeOf([flair]), step), true);
  takeSteps([step]);
  choose({ protocol: "own" });
  assert.equal(stepOnScreen(storeOf([])), "FLAIR");
  takeSteps([{ ...step, view: "left" }]);
  assert.equal(stepOnScreen(storeOf([])), null);
});

test("once somebody else has signed in, nothing of this page is kept as theirs", async () => {
  await isKept();
  who = "proxy:ben";
  kept = {};
  asked = [];
  choose({ theme: "dark" });
  await isKept();
  assert.deepEqual(asked, ["PUT"]);
  assert.match(noted.value.words, /Somebody else has signed in/);
  choose({ theme: "light" });
  await isKept();
  assert.deepEqual([kept, asked], [{}, ["PUT"]]);
  // Another page of this browser is Ben’s.
  stored.set("isocortex-owner", JSON.stringify(who));
  stored.set("isocortex", "{}");
  choose({ reader: "Ana" });
  assert.equal(stored.get("isocortex"), "{}");
});

test("a server that does not answer at first is asked again, and what is chosen meanwhile counts", async ({ mock }) => {
  mock.timers.enable({ apis: ["setTimeout"] });
  who = "proxy:cid";
  kept = { choices: { theme: "light", wheel: "zoom" } };
  fails = 1;
  holder.value = { name: who, scopes: ["read"] };
  await followPerson();
  assert.notEqual(preferences.value.theme, "light");
  choose({ wheel: "depth" });
  mock.timers.tick(5000);
  await new Promise(setImmediate);
  assert.deepEqual([preferences.value.theme, preferences.value.wheel], ["light", "depth"]);
  await isKept();
  assert.deepEqual(kept["choices"], { ...(kept["choices"] as object), theme: "light", wheel: "depth" });
});
