// A proxy in front of the server signs people in: the page says who it is, goes on after the end of a session without a loss, and signs out
// at the proxy.

import assert from "node:assert/strict";
import { once } from "node:events";
import { readFile } from "node:fs/promises";
import { type Server as HttpServer, createServer, request } from "node:http";
import type { AddressInfo } from "node:net";
import path from "node:path";
import { after, before, test } from "node:test";

import type { Browser, Page } from "playwright-core";

import { violations } from "./axe.ts";
import { brainMask, markedVolume } from "./phantom.ts";
import {
  type Server,
  type Stage,
  configured,
  findingsOf,
  keep,
  openPage,
  shown,
  skip,
  startStage,
  until,
} from "./support.ts";
import { sendCase } from "./uploads.ts";

const TOKEN = { authorization: "Bearer a-token-of-the-tests" };

let stage: Stage | undefined;
let server: Server;
let proxy: HttpServer;
let address: string;
let browser: Browser;
let id: string;
/** Who is signed in at the proxy. */
let person: string | null = "ana";

/** A proxy as it should be: it removes what clients send, and answers 401 to what pages ask for while nobody is signed in. */
function startProxy(socketPath: string): HttpServer {
  return createServer((incoming, answer) => {
    const { method = "GET", url = "/" } = incoming;
    if (url === "/oauth2/sign_out") {
      person = null;
      return void answer
        .setHeader("content-type", "text/html")
        .end(`<title>Out</title><link rel="icon" href="data:,"><p>You have signed out.</p>`);
    }
    if (person === null && url.startsWith("/v1/")) return void answer.writeHead(401).end("<p>Sign in.</p>");
    const { "x-remote-user": _user, "x-remote-groups": _groups, ...headers } = incoming.headers;
    const named = person === null ? {} : { "x-remote-user": person, "x-remote-groups": "readers" };
    const asked = request({ socketPath, method, path: url, headers: { ...headers, ...named } }, (answered) => {
      answer.writeHead(answered.statusCode ?? 502, answered.headers);
      answered.pipe(answer);
    });
    asked.on("error", () => answer.destroy());
    answer.on("close", () => asked.destroy());
    incoming.pipe(asked);
  });
}

before(
  async () => {
    if (skip) return;
    const socketIn = (folder: string): string => path.join(folder, "proxy.sock");
    const settings = (folder: string): string[] => [
      `[http]`,
      `token = "${TOKEN.authorization.slice(7)}"`,
      `[proxy]`,
      `user_header = "X-Remote-User"`,
      `groups_header = "X-Remote-Groups"`,
      `sign_out = "/oauth2/sign_out"`,
      `socket = "${socketIn(folder)}"`,
      `[proxy.roles]`,
      `readers = "editor"`,
    ];
    stage = await startStage("serve", (folder) => configured(folder, settings(folder).join("\n")));
    ({ server, browser } = stage);
    id = await sendCase(server, { volume: markedVolume(), mask: brainMask() }, TOKEN);
    proxy = startProxy(socketIn(stage.folder)).listen(0, "127.0.0.1");
    await once(proxy, "listening");
    address = `http://127.0.0.1:${(proxy.address() as AddressInfo).port}/`;
  },
  { timeout: 600_000 },
);

after(async () => {
  proxy?.closeAllConnections();
  proxy?.close();
  await stage?.end();
});

test("the proxy says who it is, and the end of its session loses nothing", { skip }, async () => {
  const { page, context, troubles } = await openPage(browser, { locale: "en-GB" });
  await page.goto(`${address}#${id}&r=mesh&d=12&l=slices&x=-38,0,0`);
  await shown(page);
  await page.waitForSelector(".rows", { state: "attached" });
  await page.locator("#who").waitFor();
  assert.equal(await page.locator("#who").innerText(), "ana");

  // The session ends at the proxy, while a finding is written.
  const mark = page.getByRole("button", { name: "Mark the cross as a finding", disabled: false });
  await mark.waitFor();
  person = null;
  // Another request may have met the end before: the dialog lies over the button then.
  await mark.evaluate((button: HTMLElement) => button.click());
  await page.locator("dialog.ask-proxy").waitFor();
  await keep(page, "proxy-session-ended");
  assert.deepEqual(await violations(page), []);
  // Whoever is still out is asked again.
  await page.getByRole("button", { name: "I have signed in: go on" }).click();
  await page.locator("dialog.ask-proxy").waitFor();
  assert.equal(await page.locator("#sign-in").getAttribute("target"), "_blank");
  person = "ana";
  await page.getByRole("button", { name: "I have signed in: go on" }).click();
  await page.locator("dialog.ask-proxy").waitFor({ state: "detached" });
  const list = () => findingsOf(server, id, TOKEN);
  assert.equal((await until(list, ({ length }) => length === 1)).length, 1);

  await page.locator("#who").click();
  await page.locator("#holder").waitFor();
  await keep(page, "proxy-who");
  assert.match(await page.locator("dialog.holder").innerText(), /ana[^]*read, write, results/);
  await page.locator("#sign-out").click();
  await page.getByText("You have signed out.").waitFor();
  assert.equal(page.url(), new URL("/oauth2/sign_out", address).href);
  assert.deepEqual(
    troubles.filter((trouble) => !/status of 401/.test(trouble)),
    [],
  );
  await context.close();
});

test("two readers sign, each without seeing the other’s conclusion before, and compare both", { skip }, async () => {
  const findings = (own: unknown) => (own as { findings: readonly unknown[] }).findings;
  const readingOf = async (reader: string) =>
    (await fetch(new URL(`v1/cases/${id}/readings/by/${reader}`, address))).json() as Promise<Record<string, unknown>>;
  /** Opens the case as somebody, with the section of readings unfolded. */
  const openAs = async (reader: string) => {
    person = reader;
    const opened = await openPage(browser, { locale: "en-GB" });
    await opened.page.goto(`${address}#${id}&r=mesh&d=12&l=slices&x=-38,0,0`);
    await shown(opened.page);
    await opened.page.locator(".reading > summary").click();
    await opened.page.locator("#conclusion:enabled").waitFor();
    return opened;
  };
  const sign = async (page: Page): Promise<void> => {
    await page.getByRole("button", { name: "Sign …" }).click();
    const dialog = page.locator("dialog.confirm-sign");
    await dialog.waitFor();
    assert.match(await dialog.innerText(), /Version 1 is locked[^]*findings of the list \(1\)/);
    await dialog.getByRole("button", { name: "Sign", exact: true }).click();
    await page.locator(".signed").waitFor();
  };

  const ana = await openAs("ana");
  await ana.page.locator("#conclusion").fill("Blurred junction on the right.\nNothing else.");
  await ana.page.getByText("Stored on the server.").first().waitFor();
  await ana.page.getByText("In fixed words").click();
  await ana.page.locator("#template-side").selectOption({ label: "Right" });
  await ana.page.locator("#template-gyrus").selectOption({ label: "middle frontal gyrus" });
  await ana.page.locator("#template-blur").selectOption({ label: "present" });
  await keep(ana.page, "reading-template");
  await sign(ana.page);
  await keep(ana.page, "reading-signed");
  assert.match(await ana.page.locator(".signed").innerText(), /^Version 1: signed by ana on /);
  assert.ok(await ana.page.locator("#conclusion").isDisabled());
  assert.deepEqual(await violations(ana.page), []);
  const download = ana.page.waitForEvent("download");
  await ana.page.getByRole("button", { name: "Save the report" }).first().click();
  const report = await readFile(await (await download).path(), "utf8");
  assert.match(report, /Signed by <bdi>ana<\/bdi> on /);
  assert.match(report, /class="large[^>]*><bdi>Blurred junction on the right\.<\/bdi>/);
  assert.match(report, /<th>Side<\/th><td>Right<\/td>[^]*<th>Blurred boundary<\/th><td>present<\/td>/);
  const signed = await readingOf("proxy:ana");
  assert.deepEqual([signed.state, findings(signed).length], ["signed", 1]);

  const ben = await openAs("ben");
  await ben.page.getByText(/^ana: signed on /).waitFor();
  await ben.page.getByText("Shown once you have signed your own reading.").waitFor();
  assert.equal((await readingOf("proxy:ana")).type, "urn:isocortex:problem:reading-hidden");
  assert.doesNotMatch(await ben.page.locator("body").innerText(), /Blurred junction/);
  await ben.page.locator("#conclusion").fill("Normal.");
  await sign(ben.page);
  await ben.page.getByRole("button", { name: "Compare with ana" }).click();
  const both = ben.page.locator("dialog.readings");
  await both.locator(".conclusions").waitFor();
  await keep(ben.page, "readings-compared");
  const [normal, blurred] = await both.locator(".conclusions td").allInnerTexts();
  assert.equal(normal, "Normal.");
  assert.match(
    blurred ?? "",
    /^Blurred junction on the right\.\nNothing else\.\s+Side: Right\s+Gyrus: middle frontal gyrus\s+Blurred boundary: present$/,
  );
  assert.match(await both.innerText(), /Same place within 10 mm: 1[^]*In your reading alone: 0/);
  assert.deepEqual(await violations(ben.page), []);
  await both.getByRole("button", { name: "Close" }).click();

  await ben.page.getByRole("button", { name: "Correct" }).click();
  await ben.page.getByText(/^Version 2, a correction, is open/).waitFor();
  assert.equal(await ben.page.locator("#conclusion").inputValue(), "Normal.");
  for (const { context, troubles } of [ana, ben]) {
    assert.deepEqual(
      troubles.filter((trouble) => !/status of 401/.test(trouble)),
      [],
    );
    await context.close();
  }
});

/** Waits until a page has taken over what the server keeps for whoever is signed in. */
const followed = (page: Page): Promise<string | null> =>
  until(
    () => page.evaluate(() => localStorage.getItem("isocortex-owner")),
    (owner) => owner === JSON.stringify(`proxy:${person}`),
  );
const layouts = (page: Page): Promise<string[]> => page.locator(".saved-layouts button[dir]").allTextContents();
const layoutsSection = (page: Page) => page.locator(".group", { hasText: "Saved layouts" });
const preferencesKept = async () =>
  (await (await fetch(new URL("v1/preferences", address))).json()) as Record<string, unknown>;

test("what somebody has saved is theirs in every browser, and nobody else's", { skip }, async () => {
  const openAs = async (reader: string) => {
    person = reader;
    const opened = await openPage(browser, { locale: "en-GB" });
    await opened.page.goto(`${address}#${id}&r=mesh&d=12&l=slices`);
    await shown(opened.page);
    await followed(opened.page);
    return opened;
  };
  const first = await openAs("ana");
  await layoutsSection(first.page).locator("summary").click();
  await first.page.locator("#layout-name").fill("Slices at 12");
  await first.page.getByRole("button", { name: "Save what is shown" }).click();
  await first.page.getByText("kept on the server for you").waitFor();
  await first.page.getByRole("button", { name: "Use as my steps" }).click();
  await until(
    preferencesKept,
    ({ layouts: saved, steps, choices }) =>
      (saved as unknown[] | undefined)?.length === 1 &&
      (steps as unknown[] | undefined)?.length === 1 &&
      (choices as { protocol?: string } | undefined)?.protocol === "own",
  );
  await keep(first.page, "layouts-named");
  assert.deepEqual(await violations(first.page), []);
  const download = first.page.waitForEvent("download");
  await layoutsSection(first.page).getByRole("button", { name: "Save as a file" }).click();
  const file = await (await download).path();

  // The same person in another browser.
  const second = await openAs("ana");
  assert.deepEqual(await layouts(second.page), ["Slices at 12"]);
  assert.deepEqual(await second.page.locator(".steps button").allTextContents(), ["Slices at 12"]);

  const other = await openAs("ben");
  assert.deepEqual(await layouts(other.page), []);
  await layoutsSection(other.page).locator("summary").click();
  await other.page.locator("#layouts-file").setInputFiles(file);
  await other.page.getByText("Layouts of the file: 1. Your own steps are now those of the file: 1.").waitFor();
  assert.deepEqual(await layouts(other.page), ["Slices at 12"]);
  await other.page.evaluate(() => (document.documentElement.dataset["theme"] = "light"));
  await keep(other.page, "layouts-named-light");
  for (const { context, troubles } of [first, second, other]) {
    assert.deepEqual(troubles, []);
    await context.close();
  }
});

test("whoever signs in after somebody else, in the same browser, begins with nothing of theirs", { skip }, async () => {
  const { page, context, troubles } = await openPage(browser, { locale: "en-GB" });
  const openAs = async (reader: string): Promise<void> => {
    person = reader;
    await page.goto("about:blank");
    await page.goto(`${address}#${id}&r=mesh&d=12&l=slices`);
    await shown(page);
    await followed(page);
  };
  const save = async (name: string): Promise<void> => {
    const section = layoutsSection(page);
    if ((await section.getAttribute("open")) === null) await section.locator("summary").click();
    await page.locator("#layout-name").fill(name);
    await page.getByRole("button", { name: "Save what is shown" }).click();
    await until(preferencesKept, ({ layouts: saved }) => JSON.stringify(saved ?? []).includes(name));
  };

  await openAs("zoe");
  await page.locator("#reader").fill("Dr Zoe");
  await page.locator("#reader").press("Tab");
  await save("Of Zoe");
  assert.equal(((await preferencesKept())["choices"] as { reader: string }).reader, "Dr Zoe");

  await openAs("ron");
  assert.deepEqual(await layouts(page), []);
  assert.equal(await page.locator("#reader").inputValue(), "");
  await page.locator("#reader").fill("Dr Ron");
  await page.locator("#reader").press("Tab");
  await save("Of Ron");
  assert.doesNotMatch(JSON.stringify(await preferencesKept()), /Zoe/);

  // Ron leaves his page open, and Zoe signs in elsewhere.
  person = "zoe";
  await page.locator("#layout-name").fill("Whose");
  await page.getByRole("button", { name: "Save what is shown" }).click();
  await page.getByText("Somebody else has signed in").first().waitFor();
  assert.doesNotMatch(JSON.stringify(await preferencesKept()), /Ron|Whose/);
  await openAs("zoe");
  assert.deepEqual(await layouts(page), ["Of Zoe"]);
  assert.equal(await page.locator("#reader").inputValue(), "Dr Zoe");
  assert.deepEqual(
    troubles.filter((trouble) => !/status of 412/.test(trouble)),
    [],
  );
  await context.close();
});
